"""Relevancy maps of other methods, as anyone may write them."""

import random
from collections.abc import Callable, Iterator

import numpy as np
import zarr

from bad_input_bench.artifacts import chunk_of
from bad_input_bench.cases import Case, Sandbox, Words, stage_flags
from bad_input_bench.mutations import as_folder, circular, cut, dangling, fill, lose

FAMILY = "relevancy maps"
Maps = dict[str, object]

ODD: dict[str, Callable[[Maps], object]] = {
    "no levels": lambda told: told.update(levels=[]),
    "levels of one name": lambda told: told.update(levels=["a", "a"]),
    "levels in words": lambda told: told.update(levels="abc"),
    "no method": lambda told: told.pop("method"),
    "a method that is a number": lambda told: told.update(method=3),
    "a method with a newline": lambda told: told.update(method="a\nb"),
    "a method of 1000 letters": lambda told: told.update(method="x" * 1000),
    "no categories": lambda told: told.pop("category"),
    "a category too few": lambda told: told.update(category=["cup"]),
    "categories that are numbers": lambda told: told.update(category=[1, 2]),
    "blank categories": lambda told: told.update(category=["", " "]),
    "a category twice": lambda told: told.update(category=["cup", "cup"]),
    "another schema": lambda told: told.update(schema="frames"),
    "a version to come": lambda told: told.update(format_version=2),
    "maps of integers": lambda told: told.update(maps=np.ones((2, 1, 96, 96), np.int32)),
    "maps of three axes": lambda told: told.update(maps=np.ones((2, 96, 96), np.float32)),
    "maps of another shape": lambda told: told.update(maps=np.ones((2, 1, 96, 30), np.float32)),
    "maps above 1": lambda told: told.update(maps=np.full((2, 1, 96, 96), 7, np.float32)),
    "no maps": lambda told: told.update(maps=None),
    "no rows": lambda told: told.update(
        maps=np.ones((0, 1, 96, 96), np.float32), frame=np.zeros(0, np.int64)
    ),
    "frames that are no numbers": lambda told: told.update(frame=np.array([0.5, 1.5])),
    "frames that there are not": lambda told: told.update(frame=np.array([900, 901])),
    "queries left out": lambda _: None,
}


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    for what, change in ODD.items():
        yield Case(FAMILY, what, lambda box, change=change: _score(box, change), ("relevancy.zarr",))
    ways = {
        "absent": lose,
        "a link to nothing": dangling,
        "a link to itself": circular,
        "a file": lambda path: (lose(path), fill("hello")(path)),
        "an empty folder": lambda path: (lose(path), path.touch(), as_folder(path)),
        "a chunk lost": lambda path: lose(chunk_of(path / "relevancy")),
        "half a chunk": lambda path: cut(0.5)(chunk_of(path / "frame")),
        "metadata of zeros": lambda path: fill(b"\0" * 50)(path / "zarr.json"),
        "metadata nested without end": lambda path: fill("[" * 50_000)(path / "zarr.json"),
        "an array's metadata empty": lambda path: fill(b"")(path / "frame/zarr.json"),
    }
    for what, change in ways.items():

        def command(box: Sandbox, change: Callable = change) -> Words:
            words = _score(box, lambda _: None)
            change(box.folder / "relevancy.zarr")
            return words

        yield Case(FAMILY, what, command, ("relevancy.zarr",))


def _score(box: Sandbox, change: Callable[[Maps], object]) -> Words:
    told: Maps = {
        "schema": "relevancy",
        "format_version": 1,
        "method": "Other",
        "levels": ["all"],
        "category": ["cup", "table"],
        "maps": np.full((2, 1, 96, 96), 0.5, np.float32),
        "frame": np.array([0, 1], np.int64),
    }
    change(told)
    maps, frame = told.pop("maps"), told.pop("frame")
    path = box.folder / "relevancy.zarr"
    group = zarr.open_group(path, mode="w")
    for name, values in {"relevancy": maps, "frame": frame}.items():
        if values is not None:
            group.create_array(name, data=values, config={"write_empty_chunks": True})
    group.attrs.put(told)
    return stage_flags("method_metrics", box, relevancy=path)
