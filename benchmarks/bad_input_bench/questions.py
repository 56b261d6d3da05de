"""Words and places that nobody can be asked of: ``egosplat query`` and ``egosplat export``."""

import json
import random
from collections.abc import Iterator

from bad_input_bench.cases import Case, Sandbox, Words
from bad_input_bench.mutations import JSON_RUBBISH, RUBBISH, Break, fill, lose

FAMILY = "questions"
ODD_WORDS = (
    "; touch ../outside/canary",
    "$(touch ../outside/canary)",
    "$\\frac{1}{$",
    "$x$ and $",
    "\u202eleft to right",
    "\u65e5\u672c\u8a9e",
    "\U0001f600 cup",
    "%s %d {phrase}",
    "<script>",
    "'\"",
)
"""Words that are odd, and yet words."""

POSES = {
    "3 x 3": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "zeros": [[0] * 4] * 4,
    "of another scale": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]],
    "a mirror": [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "infinitely far": [[1, 0, 0, 1e999], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "no numbers": [["a"] * 4] * 4,
    "of 400 digits": [[10**400, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "null": None,
    "rows of several lengths": [[1], [1, 2]],
}


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    for words in ("", " ", "\t\n", "cup " * 200, "a\nb", "a\x1b[2J", "\udcff\udcfe"):
        yield Case(FAMILY, f"words {words[:20]!r}", lambda box, words=words: _query(box, words), ("query",))
    for words in ODD_WORDS:
        fine = "any words may be asked; nothing is run of them, and they are drawn as they are"
        yield Case(FAMILY, f"words {words!r}", lambda box, words=words: _query(box, words), ("query",), fine)
    for what, change in (RUBBISH | JSON_RUBBISH).items():
        yield _pose(what, change)
    for what, value in POSES.items():
        yield _pose(what, fill(json.dumps({"camera_to_world": value})))
    odd: dict[str, list[object]] = {
        "a frame beyond the last": ["--frame", 10**6],
        "a frame below 0": ["--frame", -1],
        "a frame in words": ["--frame", "first"],
        "a frame and a pose": ["--frame", 0, "--pose", "pose.json"],
        "no temperature": ["--temperature", 0],
        "a temperature of NaN": ["--temperature", "nan"],
        "canonical phrases that are none": ["--canonical", "[]"],
        "canonical phrases that are numbers": ["--canonical", "[1]"],
        "canonical phrases nested": ["--canonical", "[" * 20_000],
        "a device that is not there": ["--device", "cuda"],
        "a picture in a file's folder": ["--output", "tiny.yaml/a.png"],
        "a picture in place of a folder": ["--output", "config"],
        "a picture without a name": ["--output", ""],
        "a picture up": ["--output", ".."],
    }
    named = {"a device that is not there": "cuda", "a frame and a pose": "--frame"}
    for what, words in odd.items():
        name = named.get(what, str(words[0]))
        yield Case(
            FAMILY,
            what,
            lambda box, words=words: [*_query(box, "cup"), *words],
            (name, str(words[1])[:20] or "output", "tiny.yaml"),
        )
    for name in ("frames", "poses", "features", "splats", "language"):
        yield _without(name, "query")
    for name in ("splats", "language"):
        yield _without(name, "export")
    for folder in ("no/such/scene", "config", "", "x" * 300, "tiny.yaml"):
        yield Case(
            FAMILY,
            f"a scene {folder[:20]!r}",
            lambda _, folder=folder: ["query", folder, "cup"],
            (folder[:20],),
        )


def _query(box: Sandbox, words: str) -> Words:
    return ["query", box.scene, "--", words] if words.startswith("-") else ["query", box.scene, words]


def _pose(what: str, change: Break) -> Case:
    def command(box: Sandbox) -> Words:
        path = box.folder / "pose.json"
        path.write_text("{}")
        change(path)
        return [*_query(box, "cup"), "--pose", path]

    return Case(FAMILY, f"a pose: {what}", command, ("pose.json",))


def _without(name: str, asked: str) -> Case:
    def command(box: Sandbox) -> Words:
        lose(box.scene / f"{name}.zarr")
        return [asked, box.scene, *(["cup"] if asked == "query" else [])]

    return Case(FAMILY, f"{asked} without {name}.zarr", command, (f"{name}.zarr",))
