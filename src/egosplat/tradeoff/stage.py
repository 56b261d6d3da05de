"""Speed against accuracy of a scene: from the scores of its points to a page, a picture and tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from egosplat.atomic import whole_file
from egosplat.errors import UserError
from egosplat.progress import log
from egosplat.tradeoff.document import tradeoff_document, write_document
from egosplat.tradeoff.measured import read_points
from egosplat.tradeoff.page import to_html
from egosplat.tradeoff.picture import draw
from egosplat.tradeoff.tradeoff_csv import to_csv

NAME = "tradeoff"
"""Of the files."""


def run(points: Sequence[Mapping[str, Any]], output: Path) -> None:
    """Write ``tradeoff.json``, ``.csv``, ``.png`` and ``.html``; each appears when it is complete.

    The same inputs make the same bytes.

    Args:
        points: the scene itself first, as ``egosplat.tradeoff.measured.read_points`` takes them.
        output: the folder of the files, made where it is not there.

    Raises:
        UserError: a file cannot be read, or what was measured cannot be compared.
    """
    if not isinstance(points, Sequence) or not points or not all(map(_is_point, points)):
        raise UserError(
            "--points: no list of points, at least one, the scene itself: each an object with the lists settings and "
            "metrics and the object keys"
        )
    document = tradeoff_document(read_points(points))
    write_document(output / f"{NAME}.json", document, schema="tradeoff")
    _write(output / f"{NAME}.csv", to_csv(document))
    draw(document, output / f"{NAME}.png")
    _write(output / f"{NAME}.html", to_html(document, output / f"{NAME}.png"))
    log(f"{len(points)} points, {document['seeds']} runs each: {output / NAME}.html")


def _is_point(point: object) -> bool:
    kinds = {"settings": list, "metrics": list, "keys": Mapping}
    return isinstance(point, Mapping) and all(
        isinstance(point.get(name), kind) for name, kind in kinds.items()
    )


def _write(path: Path, text: str) -> None:
    with whole_file(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
