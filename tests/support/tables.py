"""Tables that benchmarks print, the table of scenes, and scores as they stand in metrics.json."""

from pathlib import Path

from egosplat.pipeline.config import resolve
from egosplat.pipeline.scenes import Scene, read_scenes
from tests.support import PRESETS

OPTIONS = {"min_area": 0.001, "excluded": ["shelter"], "masks": "threshold"}
"""Keys of the section metrics that scores in one table must share."""

SETUP = {"seed": 0, "preset": "balanced", "commit": "c0de", "clean": True, "recording": {"kind": "adt"}}
SETUP["recording"] |= {
    "name": "recording",
    "hash": "d",
    "frames": 3,
    "seconds": 1.0,
    "seed": 1,
    "camera": "ideal",
}
"""What was measured, and how."""


def cells(text: str) -> list[list[str]]:
    """The cells of all rows of the Markdown tables in a text, headings first; lines that align columns are left out."""
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"
    ]
    return [row for row in rows if set("".join(row)) - set("-:")]


def scenes_of(folder: Path, text: str, **user: object) -> dict[tuple[str, str], Scene]:
    """Write ``scenes.tsv`` and read its scenes, with a user's keys."""
    (folder / "scenes.tsv").write_text(text, encoding="utf-8")
    return read_scenes(resolve({"scenes": str(folder / "scenes.tsv"), **user}, PRESETS))
