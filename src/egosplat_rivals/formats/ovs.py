"""Read the pictures of a scene of 3D-OVS: its class masks choose the evaluation frames (docs/recordings.md).

A scene has ``images/``, perhaps a COLMAP model in ``sparse/0/``, and ``segmentations/`` with ``classes.txt`` and a folder of
masks, ``04/CLASS.png``, for each labeled picture.
"""

from pathlib import Path

from egosplat.frames import pictures
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat_rivals.formats.labeled_annotations import find_labels, match_labels


def open_recording(path: Path, options: FramesOptions) -> Recording:
    """Open the pictures of a scene."""
    labels = find_labels("3d_ovs", path)
    return pictures.open_recording(path, options, lambda names: [*match_labels(labels, names)])
