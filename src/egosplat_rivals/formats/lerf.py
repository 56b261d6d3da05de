"""Read the pictures of a scene of LERF-OVS: LangSplat's labels choose the evaluation frames (docs/recordings.md).

A scene is the folder of a COLMAP project, ``figurines/images/`` and ``figurines/sparse/0/``; its labels lie beside it, in
``label/figurines/frame_00041.json`` for picture ``frame_00041.jpg``.
"""

from pathlib import Path

from egosplat.frames.labels import find_labels
from egosplat.frames.options import FramesOptions
from egosplat.frames.pictures import PlainRecording


def open_recording(path: Path, options: FramesOptions) -> PlainRecording:
    """Open the pictures of a scene."""
    return PlainRecording(path, options, find_labels("lerf", path))
