"""Read another method's relevancy maps from a Zarr group that anyone can write (docs/external_methods.md)."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from egosplat.artifacts.integrity import digest_of
from egosplat.artifacts.schema import Field, Schema, check_shape
from egosplat.errors import UserError, reraise_as

RELEVANCY = Schema(
    "relevancy",
    1,
    {
        "relevancy": Field(
            ("query", "level", "height", "width"),
            "float32",
            "0..1",
            "how well each pixel fits the query; NaN where nothing is seen; float16 does too",
            by_row=True,
        ),
        "frame": Field(("query",), "int64", "index", "frame in frames.zarr that the query is asked in"),
    },
)
"""The group's attributes: ``schema``, ``format_version``, ``method`` (its name), ``levels`` (their names) and
``category`` (the text of each query)."""

FLOATS = ("float16", "float32")
"""Allowed number types of the maps."""

LONGEST_NAME = 60


@dataclass(frozen=True, eq=False)
class Relevancy:
    """Another method's maps; made by ``open_relevancy``.

    Attributes:
        path: path of the group.
        method: name of the method.
        levels: names of the levels, at least one.
        rows: row of each pair (frame, category).
        digest: SHA-256 over arrays and attributes.
    """

    path: Path
    method: str
    levels: tuple[str, ...]
    rows: dict[tuple[int, str], int]
    digest: str
    _maps: zarr.Array

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of a map [px]."""
        return self._maps.shape[2:]

    def maps(self, frame: int, category: str) -> NDArray[np.float32]:
        """The maps of a query, (L, H, W) float32; NaN where nothing is seen.

        Raises:
            UserError: the maps cannot be read, or hold a number outside 0..1.
        """
        row = self.rows[frame, category]
        where = f"{self.path}: relevancy[{row}], {category!r} in frame {frame}"
        with reraise_as(_damaged(f"{where}, cannot be read", "; write it again")):
            values = np.asarray(self._maps[row], np.float32)
        if not ((values >= 0) & (values <= 1) | np.isnan(values)).all():
            raise UserError(
                f"{where}, holds numbers outside 0..1; scale them, and put NaN where nothing is seen"
            )
        return values


def open_relevancy(path: Path) -> Relevancy:
    """Open another method's maps and check everything except the values of the maps.

    Raises:
        UserError: the group is absent or has another layout.
    """
    group, attributes = _open(path)
    sizes: dict[str, int] = {}
    for name, declared in RELEVANCY.fields.items():
        _check_array(path, group, name, declared, sizes)
    levels = _texts(path, attributes, "levels", sizes["level"])
    categories = _texts(path, attributes, "category", sizes["query"])
    if len(set(levels)) < len(levels):
        raise UserError(f"{path}: attribute levels names a level twice")
    frames = _read_frames(path, group)
    rows = {pair: row for row, pair in enumerate(zip(frames, categories, strict=True))}
    if len(rows) < len(categories):
        raise UserError(f"{path}: holds a category twice in one frame")
    return Relevancy(
        path, _method(path, attributes), levels, rows, _digest(path, attributes), group["relevancy"]
    )


def _damaged(what: str, advice: str = "") -> Callable[[Exception], UserError]:
    """Describe an error that zarr raises for a damaged group."""
    return lambda error: UserError(f"{what} ({type(error).__name__}){advice}")


def _open(path: Path) -> tuple[zarr.Group, dict[str, Any]]:
    if not path.exists():
        raise UserError(f"{path}: does not exist. docs/external_methods.md describes the layout")
    with reraise_as(_damaged(f"{path}: is no readable Zarr group")):
        group = zarr.open_group(path, mode="r")
        attributes = group.attrs.asdict()
    found = (attributes.get("schema"), attributes.get("format_version"))
    if found != (RELEVANCY.name, RELEVANCY.version):
        raise UserError(
            f"{path}: attributes schema and format_version are {found[0]!r} and {found[1]!r}, not {RELEVANCY.name!r} "
            f"and {RELEVANCY.version}; see docs/external_methods.md"
        )
    return group, attributes


def _read_frames(path: Path, group: zarr.Group) -> list[int]:
    with reraise_as(_damaged(f"{path}: array 'frame' cannot be read", "; write it again")):
        return np.asarray(group["frame"][...]).tolist()


def _check_array(path: Path, group: zarr.Group, name: str, declared: Field, sizes: dict[str, int]) -> None:
    with reraise_as(_damaged(f"{path}: array {name!r} is unreadable")):
        array = group.get(name)
    if not isinstance(array, zarr.Array):
        raise UserError(f"{path}: lacks the array {name!r}; see docs/external_methods.md")
    fits = array.dtype.kind in "iu" if name == "frame" else array.dtype in FLOATS
    if not fits:
        raise UserError(f"{path}: array {name!r} is {array.dtype}, not {' or '.join(_allowed(name))}")
    try:
        check_shape(declared, array.shape, sizes, name)
    except ValueError as error:
        raise UserError(f"{path}: array {error}") from None
    if array.size and (lost := array.nchunks - array.nchunks_initialized):
        raise UserError(
            f"{path}: array {name!r} lacks {lost} of {array.nchunks} chunks; was it written to its end?"
        )


def _allowed(name: str) -> tuple[str, ...]:
    return ("an integer",) if name == "frame" else FLOATS


def _texts(path: Path, attributes: dict[str, Any], key: str, count: int) -> tuple[str, ...]:
    texts = attributes.get(key)
    if not isinstance(texts, list) or not all(isinstance(one, str) and one.strip() for one in texts):
        raise UserError(f"{path}: attribute {key} is no list of texts")
    if len(texts) != count or not count:
        raise UserError(
            f"{path}: attribute {key} has {len(texts)} texts, the arrays have {count}; at least 1"
        )
    return tuple(texts)


def _method(path: Path, attributes: dict[str, Any]) -> str:
    name = attributes.get("method")
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
        raise UserError(f"{path}: attribute method is no name of 1 to {LONGEST_NAME} printable characters")
    return name.strip()


def _digest(path: Path, attributes: dict[str, Any]) -> str:
    """SHA-256 over arrays and attributes."""
    told = json.dumps(attributes, sort_keys=True)
    return hashlib.sha256(f"{digest_of(path)}\n{told}".encode()).hexdigest()
