"""``front.json``: the points of a measured trade-off that a budget chooses from."""

from pathlib import Path
from typing import Any

from egosplat import config as configuration
from egosplat.errors import UserError
from egosplat.output_files import check_output, json_kind
from egosplat.progress import log
from egosplat.tradeoff.document import write_document

FORMAT_VERSION = 1

FRONT = json_kind("egosplat front", "format_version", "measured", "points")


def run(tradeoff: Path, output: Path) -> None:
    """Write the Pareto front of a ``tradeoff.json`` as ``front.json``.

    Raises:
        UserError: the file cannot be read, was measured on several machines, or has no front, or something is at ``output`` that
            is no front.
    """
    check_output(output, FRONT)
    document = configuration.read_json(tradeoff, "tradeoff")
    if len(document["machines"]) > 1:
        raise UserError(
            f"{tradeoff}: was measured on several machines ({'; '.join(document['machines'])}), whose times cannot be "
            "compared.\nMeasure it on one"
        )
    points = sorted((one for one in document["points"] if one["front"]), key=_minutes)
    if not points:
        raise UserError(f"{tradeoff}: has no front: nothing was asked, so no accuracy is known")
    told = ("scene", "origin", "about", "machines", "seeds", "confidence")
    front = {
        "format_version": FORMAT_VERSION,
        "measured": {key: document[key] for key in told},
        "points": [_entry(one) for one in points],
    }
    write_document(output, front, schema="front", kind=FRONT)
    log(f"{len(points)} of {len(document['points'])} points: {output}")


def _entry(point: dict[str, Any]) -> dict[str, Any]:
    return {
        "label": point["label"],
        "minutes": round(_minutes(point), 2),
        "accuracy": round(point["measures"]["accuracy"]["mean"], 4),
        "keys": point["keys"],
    }


def _minutes(point: dict[str, Any]) -> float:
    return point["measures"]["wall_s"]["mean"] / 60
