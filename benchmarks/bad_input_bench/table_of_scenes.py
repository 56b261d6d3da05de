"""Tables of scenes that are no tables, or hold what no scene may be called."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path

from bad_input_bench.cases import Case, Sandbox

FAMILY = "scenes.tsv"
HEADER = "dataset\tscene\tformat\trecording\toptions\n"
GOOD = ("adt", "scene90", "adt", "walk", "")

NAMES = (
    "../outside",
    "/etc",
    "a b",
    "a;touch ../outside/canary",
    "$(touch ../outside/canary)",
    "`touch ../outside/canary`",
    "a'b",
    '"a""b"',
    '"a\nb"',
    '"a\n"',
    "é",
    "\u202eabc",
    "",
    ".",
    "..",
    "{wildcards.scene}",
    "a" * 5000,
    "a\0b",
)
"""What neither a dataset nor a scene may be called."""

OPTIONS = (
    "stride=3",
    "frames.stride",
    "frames.=3",
    ".stride=3",
    "frames.stride=",
    "frames.stride=[",
    "frames.stride=*a",
    "frames.stride=" + "[" * 20_000,
    "frames.stride=.nan",
    "splats.lr_means=.inf",
    "frames.stride=!!python/object/apply:os.system",
    "frames.stride=3.0",
    "frames.stride=2020-01-01",
    "frames.stride=;touch${IFS}../outside/canary",
    "nothing.stride=3",
    "frames=3",
    "preset=fast",
    "scenes.x=3",
    "frames.stride.x=3",
    "variants.a=3",
    "frames.stride=2 frames.stride=\0",
)


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    for place, column in enumerate(("dataset", "scene", "format")):
        for name in NAMES:
            row = [name if index == place else value for index, value in enumerate(GOOD)]
            yield _table(f"{column} {name[:30]!r}", HEADER + "\t".join(row) + "\n", (column,))
    for options in OPTIONS:
        row = "\t".join((*GOOD[:4], options))
        yield _table(f"options {options[:40]!r}", f"{HEADER}{row}\n", ("line 2", "scenes.tsv"))
    for name in ("", "a\0b", '"a\nb"', "a\x1b[2Jb", "{wildcards.scene}", "{{x}}"):
        row = "\t".join((*GOOD[:3], name, ""))
        yield _table(f"recording {name!r}", f"{HEADER}{row}\n", ("recording", "scenes.tsv"))
    yield from _whole_files()


def _whole_files() -> Iterator[Case]:
    good = HEADER + "\t".join(GOOD) + "\n"
    contents: dict[str, str | bytes] = {
        "empty": "",
        "a header of blanks": good.replace("\t", " "),
        "commas": good.replace("\t", ","),
        "no header": "\t".join(GOOD) + "\n",
        "a column too few": HEADER.replace("\toptions", ""),
        "a column too many": HEADER.strip() + "\tmore\n",
        "a row too short": HEADER + "adt\tscene90\n",
        "a row too long": HEADER + "adt\tscene90\tadt\twalk\t\tmore\n",
        "rows one longer, as if numbered": HEADER + "0\tadt\tscene90\tadt\twalk\t\n",
        "a quote that is not closed": HEADER + 'adt\tscene90\tadt\t"walk\t\n',
        "a scene twice": good + "\t".join(GOOD) + "\n",
        "zero bytes": b"\0" * 500,
        "UTF-16": good.encode("utf-16"),
        "Latin-1": (HEADER + "adt\tscene90\tadt\tK\u00fcche\t\n").encode("latin-1"),
        "a picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
        "a field of a megabyte": HEADER + "adt\tscene90\tadt\twalk\t" + "x" * 2**20 + "\n",
    }
    for name, content in contents.items():
        yield _table(name, content, ("scenes.tsv",))
    for name, content in {
        "a mark before the header": "\ufeff" + good,
        "CRLF": good.replace("\n", "\r\n"),
    }.items():
        yield _table(
            name, content, ("scenes.tsv",), fine="spreadsheets write tables so; it is read like any other"
        )
    yield _read("none", lambda box: box.folder / "no.tsv", ("no.tsv",))
    yield _read("a folder", lambda box: box.folder, ("work",))
    yield _read("a name too long", lambda box: box.folder / ("x" * 300), ("xxx",))
    yield _read("a recording's name too long", _long_recording, ("recording", "xxx"))


def _long_recording(box: Sandbox) -> Path:
    path = box.folder / "long.tsv"
    path.write_text(HEADER + f"adt\tscene90\tadt\t{'x' * 300}\t\n")
    return path


def _table(name: str, content: str | bytes, named: tuple[str, ...], fine: str = "") -> Case:
    def path(box: Sandbox) -> Path:
        path = box.folder / "config/scenes.tsv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return _read(name, path, named, fine)


def _read(name: str, path: Callable[[Sandbox], Path], named: tuple[str, ...], fine: str = "") -> Case:
    """The table is read, and the recordings of its scenes are looked for, as the workflow begins."""

    def command(box: Sandbox) -> Callable[[], object]:
        from egosplat.pipeline.config import defaults
        from egosplat.pipeline.scenes import check_recording, read_scenes

        config = defaults() | {"scenes": str(path(box))}
        if fine:
            return lambda: read_scenes(config)
        return lambda: [check_recording(scene) for scene in read_scenes(config).values()]

    return Case(FAMILY, name, command, named, fine, scene=False)
