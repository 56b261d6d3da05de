"""Read the pictures of a scene of LERF-OVS: LangSplat's labels choose the evaluation frames (docs/recordings.md).

A scene is the folder of a COLMAP project, ``figurines/images/`` and ``figurines/sparse/0/``; its labels lie beside it, in
``label/figurines/frame_00041.json`` for picture ``frame_00041.jpg``.
"""

from pathlib import Path

from egosplat.frames import pictures
from egosplat.frames.labels import find_labels
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording


def open_recording(path: Path, options: FramesOptions) -> Recording:
    """Open the pictures of a scene."""
    return pictures.open_recording(path, options, find_labels("lerf", path))
