"""Read the pictures of a scene of LERF-OVS: LangSplat's labels choose the evaluation frames (docs/recordings.md).

A scene is the folder of a COLMAP project, ``figurines/images/`` and ``figurines/sparse/0/``; its labels lie beside it, in
``label/figurines/frame_00041.json`` for picture ``frame_00041.jpg``.
"""

from pathlib import Path

from egosplat.frames import pictures
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat_rivals.formats.labeled_annotations import find_labels, match_labels


def open_recording(path: Path, options: FramesOptions) -> Recording:
    """Open the pictures of a scene."""
    labels = find_labels("lerf", path)
    return pictures.open_recording(path, options, lambda names: [*match_labels(labels, names)])
