"""Artifacts: every array and every attribute broken, and artifacts of other kinds and scenes."""

import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path

from bad_input_bench.cases import UNREAD, Case, Sandbox, Words, stage_flags
from bad_input_bench.mutations import Break, circular, cut, dangling, fill, flip, lose
from egosplat.artifacts.integrity import seal
from egosplat.artifacts.registry import SCHEMAS
from egosplat.pipeline.stages import STAGES

READERS = ("annotations", "poses", "features", "masks", "splats", "language", "survey", "segments_sheet")
"""Stages that read artifacts, which are quick on the small scene."""

WAYS = 3
"""In so many ways each array is broken."""

ATTRIBUTES: dict[str, Callable[[dict], object]] = {
    "another digest": lambda told: told.update(digest="0" * 64),
    "another origin": lambda told: told["provenance"].update(origin="real"),
    "no facts": lambda told: told.pop("facts"),
    "no seal": lambda told: told.pop("seal"),
    "another version": lambda told: told.update(format_version=99),
    "a version in words": lambda told: told.update(format_version="one"),
}


def cases(rng: random.Random) -> Iterator[Case]:
    """All of this family."""
    for kind, schema in SCHEMAS.items():
        for name in schema.fields:
            yield from _array(kind, name, rng)
        yield from _attributes(kind)
        yield from _whole(kind)
    yield from _read_by_stages(rng)
    yield from _swapped()


def _checked(kind: str, what: str, change: Callable[[Path], object], fine: str = "") -> Case:
    """``egosplat check`` of one broken artifact."""

    def command(box: Sandbox) -> Words:
        path = box.scene / f"{kind}.zarr"
        change(path)
        return ["check", path]

    return Case(
        "artifacts: egosplat check", f"{kind}.zarr: {what}", command, ("not sound", f"{kind}.zarr"), fine
    )


def chunk_of(array: Path) -> Path:
    """One of an array's chunks: the last."""
    chunks = sorted(path for path in array.rglob("*") if path.is_file() and path.name != "zarr.json")
    return chunks[-1] if chunks else array / "zarr.json"  # an array without rows has none


def _array(kind: str, name: str, rng: random.Random) -> Iterator[Case]:
    ways: dict[str, Break] = {
        "a bit of a chunk": flip(rng.randrange(2**30)),
        "half a chunk": cut(0.5),
        "a chunk lost": lose,
        "an empty chunk": fill(b""),
    }
    broken: dict[str, Callable[[Path], object]] = {
        what: lambda path, change=change: change(chunk_of(path / name)) for what, change in ways.items()
    }
    broken["lost"] = lambda path: lose(path / name)
    broken["other metadata"] = lambda path: _reshape(path / name / "zarr.json")
    for what in rng.sample(sorted(broken), WAYS):
        yield _checked(kind, f"{name}: {what}", broken[what])


def _reshape(path: Path) -> None:
    told = json.loads(path.read_text())
    told["shape"] = [*told["shape"][:-1], told["shape"][-1] + 1]
    path.write_text(json.dumps(told))


def _attributes(kind: str) -> Iterator[Case]:
    for what, change in ATTRIBUTES.items():
        yield _checked(kind, what, lambda path, change=change: _change(path, change))
    yield _checked(kind, "a version to come", lambda path: _change(path, ATTRIBUTES["another version"], True))


def _change(path: Path, change: Callable[[dict], object], sealed: bool = False) -> None:
    document = json.loads((path / "zarr.json").read_text())
    told = document["attributes"]["egosplat"]
    change(told)
    if sealed:
        told["seal"] = seal(told)
    (path / "zarr.json").write_text(json.dumps(document))


def _whole(kind: str) -> Iterator[Case]:
    ways: dict[str, Callable[[Path], object]] = {
        "metadata empty": lambda path: fill(b"")(path / "zarr.json"),
        "metadata of zeros": lambda path: fill(b"\0" * 100)(path / "zarr.json"),
        "metadata nested without end": lambda path: fill("[" * 50_000)(path / "zarr.json"),
        "a Zarr group of someone else": lambda path: fill('{"zarr_format": 3, "node_type": "group"}')(
            path / "zarr.json"
        ),
        "attributes that are a list": lambda path: fill(
            '{"zarr_format": 3, "node_type": "group", "attributes": {"egosplat": []}}'
        )(path / "zarr.json"),
        "a file too many": lambda path: fill("more")(path / "more.bin"),
        "a file": lambda path: (lose(path), fill("hello")(path)),
        "an empty folder": lambda path: (lose(path), path.mkdir()),
        "a link to nothing": dangling,
        "a link to itself": circular,
    }
    for what, change in ways.items():
        yield _checked(kind, what, change)


def _inputs(stage: str) -> list[str]:
    """The artifacts that a reader is given here."""
    given = [name for name in STAGES[stage].inputs if name in SCHEMAS]
    return [*given, "masks"] if stage == "language" else given


def _words(stage: str, box: Sandbox, **changes: object) -> Words:
    masks = {"masks": box.scene / "masks.zarr"} if stage == "language" else {}
    return stage_flags(stage, box, **(masks | changes))


def _read_by_stages(rng: random.Random) -> Iterator[Case]:
    """Each reader with one array of each input broken in two ways; equal results show that it was not read."""
    for stage in READERS:
        for source in _inputs(stage):
            for what, change in (("a bit", flip(rng.randrange(2**30))), ("a chunk lost", lose)):
                yield _stage(stage, source, rng.choice(sorted(SCHEMAS[source].fields)), what, change)


def _stage(stage: str, source: str, array: str, what: str, change: Break) -> Case:
    def command(box: Sandbox) -> Words:
        change(chunk_of(box.scene / f"{source}.zarr" / array))
        return _words(stage, box)

    name = f"{stage}: {source}.zarr, {array}, {what}"
    return Case(
        "artifacts: stages", name, command, (f"{source}.zarr",), UNREAD, lambda box: _words(stage, box)
    )


def _swapped() -> Iterator[Case]:
    """An artifact of another kind for each input of each reader."""
    for stage in READERS:
        for source in _inputs(stage):
            for other in ("frames", "masks"):
                if other != source:
                    yield _other(stage, source, other)


def _other(stage: str, source: str, other: str) -> Case:
    def command(box: Sandbox) -> Words:
        return _words(stage, box, **{source: box.scene / f"{other}.zarr"})

    name = f"{stage}: {other}.zarr for {source}.zarr"
    return Case("artifacts: swapped", name, command, (f"{other}.zarr", source))
