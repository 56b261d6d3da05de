"""Stage ``tradeoff``: write the speed and accuracy of a scene's points as a page, a plot and tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.output_files import check_output, write_text_file
from egosplat.progress import log
from egosplat.tradeoff.measured import read_points
from egosplat.tradeoff.page import PAGE, TABLE, TRADEOFF, to_csv, to_html, tradeoff_document, write_document
from egosplat.tradeoff.picture import PICTURE, draw

NAME = "tradeoff"
"""Stem of the files."""


def run(points: Sequence[Mapping[str, Any]], output: Path) -> None:
    """Write ``tradeoff.json``, ``.csv``, ``.png`` and ``.html`` atomically; equal inputs give equal bytes.

    Args:
        points: points as in ``egosplat.tradeoff.measured.read_points``, the scene itself first.
        output: folder of the files, created if it does not exist.

    Raises:
        UserError: a file cannot be read, the scores cannot be compared, or a file would replace something else.
    """
    if not isinstance(points, Sequence) or not points or not all(map(_is_point, points)):
        raise UserError(
            "--points: must be a list of at least one point; each is an object with the lists settings and metrics"
        )
    json, csv, png, html = (output / f"{NAME}.{suffix}" for suffix in ("json", "csv", "png", "html"))
    for path, kind in ((json, TRADEOFF), (csv, TABLE), (png, PICTURE), (html, PAGE)):
        check_output(path, kind)
    document = tradeoff_document(read_points(points))
    write_document(json, document)
    write_text_file(csv, to_csv(document), TABLE)
    draw(document, png)
    write_text_file(html, to_html(document, png), PAGE)
    log(f"{len(points)} points, {document['seeds']} runs each: {html}")


def _is_point(point: object) -> bool:
    return isinstance(point, Mapping) and all(
        isinstance(point.get(name), list) for name in ("settings", "metrics")
    )
