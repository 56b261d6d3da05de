"""A trade-off on one HTML page that needs nothing beside itself."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from egosplat.output_files import text_kind
from egosplat.pipeline.stages import STAGES
from egosplat.tables.page import read_picture
from egosplat.tables.scored_scenes import CHANCE
from egosplat.tradeoff.measured import EVALUATION
from egosplat.tradeoff.measures import MEASURES, WALL
from egosplat.tradeoff.points import shown

GENERATOR = "egosplat tradeoff"
"""What the page says that it was made by."""

PAGE = text_kind(GENERATOR, ".html", mark=f'<meta name="generator" content="{GENERATOR}">')


def to_html(document: Mapping[str, Any], picture: Path) -> str:
    """The page of ``tradeoff.json``, with the picture of it.

    Raises:
        UserError: the picture cannot be read.
    """
    template = (resources.files("egosplat") / "tradeoff" / "tradeoff.html.j2").read_text(encoding="utf-8")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    points = document["points"]
    own = [f"{one['knob']}={shown(one['value'])}" for one in points[0]["settings"]]
    measured = {stage for point in points for stage in point["stages"]}
    making = [name for name in STAGES if name in measured and name not in EVALUATION]
    return environment.from_string(template).render(
        document=document,
        generator=GENERATOR,
        points=points,
        own=own,
        measures=MEASURES,
        wall=WALL,
        stages=making + [name for name in EVALUATION if name in measured],
        evaluation=EVALUATION,
        chances={name: document["chance"][key] for key, name in CHANCE.items()},
        confidence=f"{100 * document['confidence']:g} %",
        picture=read_picture(picture),
        asked_otherwise=[one["label"] for one in points if one["queries"] != points[0]["queries"]],
    )
