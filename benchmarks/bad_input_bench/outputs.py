"""Outputs that would cost something else, and links that lead elsewhere."""

import os
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image

from bad_input_bench.cases import Case, Sandbox, Words, stage_flags

FAMILY = "outputs and links"
LINK = "the link is replaced, and what it points to stays"


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    taken: dict[str, Callable[[Sandbox], object]] = {
        "a folder of someone else": lambda box: box.outside,
        "a folder with a way up": lambda _: "../outside",
        "the recording": lambda box: box.recording,
        "the scene": lambda box: box.scene,
        "the artifact that is read": lambda box: box.scene / "frames.zarr",
        "another artifact": lambda box: box.scene / "segments.zarr",
        "a file of someone else": lambda box: box.outside / "sentinel.txt",
        "nothing": lambda _: "",
        "here": lambda _: ".",
        "up": lambda _: "..",
        "the root": lambda _: "/",
        "below a file": lambda box: box.outside / "sentinel.txt/new.zarr",
        "a name too long": lambda _: "x" * 300,
        "what cannot be made": lambda _: "/proc/new.zarr",
    }
    for what, output in taken.items():
        for stage in ("poses", "masks"):
            yield _output(f"{stage} to {what}", stage, output)
    for what in ("here", "up", "the root", "below a file", "a name too long", "what cannot be made"):
        yield _output(f"survey to {what}", "survey", taken[what])
    yield _output("synthetic to a folder of someone else", "synthetic", taken["a folder of someone else"])
    for command in ("query", "export", "segments_sheet", "survey"):
        for what in FILES:
            yield _file(command, what)
    for what, target in {
        "someone else's folder": "folder",
        "a file": "sentinel.txt",
        "nothing": "nothing",
    }.items():
        yield _linked(what, target)
    yield _swapped_link()


def _output(what: str, stage: str, output: Callable[[Sandbox], object]) -> Case:
    def command(box: Sandbox) -> Words:
        return stage_flags(stage, box, output=output(box))

    named = ("outside", "scene1", "output", "is no name", "sentinel", "xxx", "/proc", "'.'", "/")
    return Case(FAMILY, what, command, named)


SUFFIXES = {"query": ".png", "export": ".ply", "segments_sheet": ".png", "survey": ".json"}

FILES: dict[str, Callable[[Path], object]] = {
    "a text": lambda path: path.write_text("not yours"),
    "a picture": lambda path: Image.new("RGB", (2, 2)).save(path, "PNG"),
    "a scan": lambda path: path.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n"),
    "JSON": lambda path: path.write_text('{"format_version": 1}'),
    "a folder": lambda path: path.mkdir(),
    "a pipe": os.mkfifo,
    "a link to a file": lambda path: path.symlink_to("sentinel.txt"),
    "a link to a device": lambda path: path.symlink_to("/dev/null"),
}
"""Of someone else, under a name with the command's own suffix."""


def _file(command: str, what: str) -> Case:
    def words(box: Sandbox) -> Words:
        path = box.outside / f"theirs{SUFFIXES[command]}"
        FILES[what](path)
        if command in ("query", "export"):
            return [command, box.scene, *(["cup"] if command == "query" else []), "--output", path]
        return stage_flags(command, box, output=path)

    return Case(FAMILY, f"{command} to {what} of someone else", words, ("theirs",))


def _linked(what: str, target: str) -> Case:
    def command(box: Sandbox) -> Words:
        box.new.symlink_to(box.outside / target)
        return stage_flags("masks", box)

    return Case(FAMILY, f"an output that is a link to {what}", command, ("new.zarr",), LINK)


def _swapped_link() -> Case:
    """An artifact that is kept elsewhere, as on a larger disk."""

    def command(box: Sandbox) -> Words:
        shutil.move(box.scene / "frames.zarr", box.folder / "kept")
        (box.scene / "frames.zarr").symlink_to(box.folder / "kept")
        return stage_flags("annotations", box)

    return Case(
        FAMILY, "an input that is a link", command, ("frames.zarr",), "links to whole artifacts are read"
    )
