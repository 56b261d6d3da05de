"""HOI4D sequences: intrinsics and videos that are none."""

import io
import random
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bad_input_bench.cases import Case, Sandbox, Words
from bad_input_bench.mutations import RUBBISH, Break, fill
from bad_input_bench.pictures import folder_of_pictures, frames, video

SEQUENCE = "ZY20210800001/H1/C11/N58/S376/s02/T2"


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    intrinsics: dict[str, bytes] = {
        "empty": b"",
        "a text": b"hello" * 100,
        "a zip archive": _archive(),
        "half a zip archive": _archive()[:40],
        "a pickle": b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x19touch ../outside/canary\x85R.",
        "an object array": _saved(np.array([{"a": 1}], object)),
        "words": _saved(np.array(["a"])),
        "2 x 2": _saved(np.eye(2)),
        "NaN": _saved(np.full((3, 3), np.nan)),
        "zeros": _saved(np.zeros((3, 3))),
        "a principal point outside": _saved(np.array([[60.0, 0, 900], [0, 60, 32], [0, 0, 1]])),
        "said to be huge": _saved(np.eye(3)).replace(b"(3, 3), }", b"(9999999, 999999), }"),
        "half of it": _saved(np.eye(3))[:100],
    }
    for what, content in intrinsics.items():
        yield _sequence(f"intrin.npy: {what}", "intrin.npy", fill(content))
    for what, change in RUBBISH.items():
        if what not in ("all but its end", "half of it"):
            yield _sequence(f"image.mp4: {what}", "align_rgb/image.mp4", change)
    yield Case(
        "recordings: HOI4D",
        "a folder that is no sequence",
        lambda box: frames(folder_of_pictures(box.folder / "photos"), box, "hoi4d"),
        ("photos",),
    )


def _sequence(what: str, file: str, change: Break) -> Case:
    def command(box: Sandbox) -> Words:
        folder = box.folder / SEQUENCE
        video(folder / "align_rgb/image.mp4")
        np.save(folder / "intrin.npy", np.array([[60.0, 0, 32], [0, 60, 32], [0, 0, 1]]))
        change(folder / file)
        return frames(folder, box, "hoi4d")

    return Case("recordings: HOI4D", what, command, (Path(file).name,))


def _saved(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def _archive() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a.npy", _saved(np.eye(3)))
    return stream.getvalue()
