"""Small, certain ways to break a file."""

import random
import shutil
from collections.abc import Callable
from pathlib import Path

DEEP = 50_000

Break = Callable[[Path], object]


def cut(share: float) -> Break:
    """Keep this share of a file's bytes."""

    def change(path: Path) -> None:
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])

    return change


def flip(seed: int) -> Break:
    """Flip one bit somewhere."""

    def change(path: Path) -> None:
        content = bytearray(path.read_bytes())
        content[random.Random(seed).randrange(len(content))] ^= 16
        path.write_bytes(content)

    return change


def fill(content: bytes | str) -> Break:
    """Put other content in a file's place."""
    return lambda path: path.write_bytes(content if isinstance(content, bytes) else content.encode())


def lose(path: Path) -> None:
    """Remove a file or folder."""
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def as_folder(path: Path) -> None:
    """Put an empty folder in a file's place."""
    path.unlink()
    path.mkdir()


def dangling(path: Path) -> None:
    """Put a link to nothing in its place."""
    lose(path)
    path.symlink_to("nowhere/at/all")


def circular(path: Path) -> None:
    """Put a link to itself in its place."""
    lose(path)
    path.symlink_to(path.name)


def replaced(old: str, new: str, count: int = -1) -> Break:
    """Replace text, which has to be there."""

    def change(path: Path) -> None:
        text = path.read_text()
        if old not in text:
            raise ValueError(f"{path} lacks {old!r}")
        path.write_text(text.replace(old, new, count))

    return change


RUBBISH: dict[str, Break] = {
    "empty": fill(b""),
    "zero bytes": fill(b"\0" * 4096),
    "a text": fill("hello\n" * 1000),
    "half of it": cut(0.5),
    "all but its end": cut(0.99),
    "absent": lose,
    "a folder": as_folder,
    "a link to nothing": dangling,
    "a link to itself": circular,
}
"""What any file may turn out to be."""

JSON_RUBBISH: dict[str, Break] = {
    "no JSON": fill("{"),
    "a list": fill("[]"),
    "a number": fill("3"),
    "null": fill("null"),
    "NaN": fill("NaN"),
    "an empty object": fill("{}"),
    "nested without end": fill("[" * DEEP),
    "objects nested without end": fill('{"a":' * DEEP),
    "UTF-16": fill("{}".encode("utf-16")),
    "Latin-1": fill('{"name": "K\u00fcche"}'.encode("latin-1")),
    "a number of 5000 digits": fill(f'{{"width": {"9" * 5000}}}'),
}
"""The same of a JSON file."""
