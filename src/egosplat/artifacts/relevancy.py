"""Read another method's relevancy maps from a Zarr group that anyone can write (docs/methods.md)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact, open_foreign
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import COUNT, SHARE_OR_UNKNOWN
from egosplat.errors import UserError

PAGE = "docs/methods.md"

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
            values=SHARE_OR_UNKNOWN,
        ),
        "frame": Field(
            ("query",), "int64", "index", "frame in frames.zarr that the query is asked in", values=COUNT
        ),
    },
)

_TEXTS = {
    "type": "array",
    "minItems": 1,
    "items": {"type": "string", "pattern": r"(?s)\s*\S.*", "allowed": "a name"},
}
_NAME = {"type": "string", "pattern": r"\A\s*\S.*\Z", "allowed": "a name on one line", "maxLength": 60}
# JSON schema of the group's attributes: the method's name, the names of the levels, and the text of each
# query.
ATTRIBUTES = {
    "required": ["schema", "format_version", "method", "levels", "category"],
    "properties": {
        "schema": {"const": RELEVANCY.name},
        "format_version": {"const": RELEVANCY.version},
        "method": _NAME,
        "levels": _TEXTS | {"uniqueItems": True},
        "category": _TEXTS,
    },
}


@dataclass(frozen=True, eq=False)
class Relevancy:
    """Another method's maps; made by ``open_relevancy``.

    Attributes:
        artifact: the group.
        levels: names of the levels, at least one.
        rows: row of each pair (frame, category).
    """

    artifact: Artifact
    method: str
    levels: tuple[str, ...]
    rows: dict[tuple[int, str], int]

    @property
    def path(self) -> Path:
        """Path of the group."""
        return self.artifact.path

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of a map [px]."""
        return self.artifact.shape("relevancy")[2:]

    def maps(self, frame: int, category: str) -> NDArray[np.float32]:
        """The (L, H, W) float32 maps of a query, NaN where nothing is seen; UserError if unreadable or outside 0..1."""
        return self.artifact.row("relevancy", self.rows[frame, category]).astype(np.float32)


def open_relevancy(path: Path) -> Relevancy:
    """Open another method's maps, checked but for the maps' values; UserError if absent or of another layout."""
    artifact = open_foreign(path, RELEVANCY, ATTRIBUTES, PAGE)
    facts, (queries, levels, *_) = artifact.facts, artifact.shape("relevancy")
    for key, count in (("levels", levels), ("category", queries)):
        if len(facts[key]) != count:
            raise UserError(f"{path}: attribute {key} has {len(facts[key])} texts, the arrays have {count}")
    asked = zip(artifact.read("frame").tolist(), facts["category"], strict=True)
    rows = {pair: row for row, pair in enumerate(asked)}
    if len(rows) < queries:
        raise UserError(f"{path}: holds a category twice in one frame")
    return Relevancy(artifact, facts["method"].strip(), tuple(facts["levels"]), rows)
