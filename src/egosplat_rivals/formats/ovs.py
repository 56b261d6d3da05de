"""Read the pictures of a scene of 3D-OVS: its class masks choose the evaluation frames (docs/recordings.md).

A scene has ``images/``, perhaps a COLMAP model in ``sparse/0/``, and ``segmentations/`` with ``classes.txt`` and a folder of
masks, ``04/CLASS.png``, for each labeled picture.
"""

from pathlib import Path

from egosplat.frames import pictures
from egosplat.frames.labels import find_labels
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording


def open_recording(path: Path, options: FramesOptions) -> Recording:
    """Open the pictures of a scene."""
    return pictures.open_recording(path, options, find_labels("3d_ovs", path))
