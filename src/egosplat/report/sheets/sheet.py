"""What every sheet does: open its artifacts, check that they belong together, write a heading with warnings, and save."""

import functools
from collections.abc import Callable, Sequence
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.drawing import draw_heading, save_figure

# Draws artifacts; returns the figure and a summary for its heading.
Draw = Callable[..., tuple[Figure, str]]


def sheet(warned: Sequence[str], fontsize: int = 12) -> Callable[[Draw], Callable[..., None]]:
    """Make the function of a stage from one that draws its artifacts; they have the names of its parameters.

    The made function takes the artifacts' paths as ``NAME_path``, ``output`` and ``title``, writes a PNG atomically, and
    raises UserError if the artifacts do not belong together.

    Args:
        warned: names of the artifacts whose notices and alarms are in the heading.
        fontsize: of the heading [points].
    """

    def decorate(draw: Draw) -> Callable[..., None]:
        names = list(signature(draw).parameters)
        places = [
            Parameter(f"{name}_path", Parameter.POSITIONAL_OR_KEYWORD, annotation=Path) for name in names
        ]
        output = Parameter("output", Parameter.POSITIONAL_OR_KEYWORD, annotation=Path)
        title = Parameter("title", Parameter.KEYWORD_ONLY, annotation=str)
        made = Signature([*places, output, title])

        @functools.wraps(draw)
        def run(*given: Any, **named: Any) -> None:
            values = made.bind(*given, **named).arguments
            opened = {name: open_artifact(values[f"{name}_path"], SCHEMAS[name]) for name in names}
            for artifact in opened.values():
                check_made_from(artifact, *(other for other in opened.values() if other is not artifact))
            figure, summary = draw(**opened)
            warnings = warnings_of(*(opened[name] for name in warned))
            draw_heading(figure, f"{values['title']}: {summary}", warnings, fontsize)
            save_figure(figure, values["output"])

        vars(run)["__signature__"] = made
        return run

    return decorate
