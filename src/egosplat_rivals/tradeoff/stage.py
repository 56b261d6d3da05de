"""Stage ``tradeoff``: write the speed and accuracy of a scene's points, or of several scenes, as a page, a plot and tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.files import write_json, write_text
from egosplat.pipeline.validation import Draft202012Validator, read_document, schema
from egosplat.progress import log
from egosplat_rivals.tradeoff.chart import draw
from egosplat_rivals.tradeoff.measured import read_points
from egosplat_rivals.tradeoff.page import to_csv, to_html, tradeoff_document

# Stem of the files.
NAME = "tradeoff"


def run(points: Sequence[Mapping[str, Any]], output: Path) -> None:
    """Write ``tradeoff.json``, ``.csv``, ``.png`` and ``.html`` of a scene atomically; equal inputs give equal bytes.

    Args:
        points: as in ``egosplat_rivals.tradeoff.measured.read_points``, the scene itself first.
        output: folder, created if it does not exist.

    Raises:
        UserError: a file cannot be read, or the scores cannot be compared.
    """
    if not isinstance(points, Sequence) or not points or not all(map(_is_point, points)):
        raise UserError(
            "--points: must be a list of at least one point; each is an object with the lists settings and metrics and "
            "the object recipe, of keys and command"
        )
    document = tradeoff_document(read_points(points))
    _write_pages([document], output)
    Draft202012Validator(schema("tradeoff")).validate(document)
    write_json(output / f"{NAME}.json", document)
    log(f"{len(points)} points, {document['seeds']} runs each: {output / NAME}.html")


def run_scenes(documents: Sequence[Path], output: Path) -> None:
    """Write ``tradeoff.csv``, ``.png`` and ``.html`` of several scenes, from their ``tradeoff.json``, atomically.

    Raises:
        UserError: a file cannot be read or is none of a trade-off.
    """
    read = [read_document(path, "tradeoff") for path in documents]
    _write_pages(read, output)
    log(f"{len(read)} scenes: {output / NAME}.html")


def _write_pages(documents: Sequence[Mapping[str, Any]], output: Path) -> None:
    csv, png, html = (output / f"{NAME}.{suffix}" for suffix in ("csv", "png", "html"))
    write_text(csv, to_csv(documents))
    draw(documents, png)
    write_text(html, to_html(documents, png))


def _is_point(point: object) -> bool:
    return (
        isinstance(point, Mapping)
        and all(isinstance(point.get(name), list) for name in ("settings", "metrics"))
        and isinstance(point.get("recipe"), Mapping)
        and point["recipe"].keys() == {"keys", "command"}
    )
