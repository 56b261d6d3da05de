"""Small recordings as a user has them."""

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.unit.frames.conftest import grey_frames, write_video


def write_pictures(folder: Path, count: int = 3) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        Image.fromarray(np.full((6, 8, 3), 9 * number, np.uint8)).save(folder / f"{number}.png")
    return folder


def pack(archive: Path, folder: Path, inside: str = "") -> Path:
    """Write the files of a folder into a .zip, below ``inside``."""
    with zipfile.ZipFile(archive, "w") as opened:
        for path in sorted(folder.rglob("*")):
            opened.write(path, f"{inside}{path.relative_to(folder)}".replace("/", inside[-1:] or "/"))
    return archive


@pytest.fixture
def recording(tmp_path: Path) -> Callable[[str], Path]:
    """Write a recording of a kind, three pictures or frames, and get its path."""

    def make(kind: str) -> Path:
        home = tmp_path / kind.replace(" ", "_")
        if "video" in kind:
            path = write_video(home / ("clip.mkv" if "cut off" in kind else "clip.mp4"), grey_frames(3), 30.0)
            duration = b"\x44\x89\x88"  # which a program that was killed has not written
            path.write_bytes(re.sub(b"(?s)" + duration + b".{8}", duration + bytes(8), path.read_bytes()))
            return path
        if kind == "glasses":
            (home / "mps/slam").mkdir(parents=True)
            (home / "mps/slam/closed_loop_trajectory.csv").touch()
            (home / "video.vrs").touch()
            return home / "video.vrs"
        images = "images" if kind in ("nerfstudio", "zip of Windows") else ""
        below = "in/side" if "nested" in kind else images
        write_pictures(home / below)
        if kind in ("nerfstudio", "zip of Windows"):
            frames = [{"file_path": f"images/{number}.png"} for number in range(3)]
            (home / "transforms.json").write_text(json.dumps({"frames": frames}))
        if "zip" in kind:
            (home / "__MACOSX").mkdir()
            return pack(tmp_path / "photos.zip", home, "cap\\" * ("Windows" in kind))
        return home

    return make
