"""Read plain recordings: any video file or folder of images, with the companion files of docs/recordings.md."""

from pathlib import Path

from egosplat.frames.keys import ReaderKeys
from egosplat.frames.pictures import PlainRecording


def open_recording(path: Path, keys: ReaderKeys) -> PlainRecording:
    """Open a video or a folder of images; see ``PlainRecording``."""
    return PlainRecording(
        path, known_poses=keys.known_poses, lens=keys.lens, pick=keys.pick, **keys.selection
    )
