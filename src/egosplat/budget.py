"""A budget of time, or an accuracy to reach: which point of the measured front it chooses."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from egosplat.errors import UserError

_MEASURE = (
    "snakemake --cores 2 results/adt/scene1/tradeoff/tradeoff.html && "
    "egosplat front results/adt/scene1/tradeoff/tradeoff.json"
)


def is_set(budget: Mapping[str, float | None]) -> bool:
    """Whether there is a budget.

    Raises:
        UserError: both of its keys are set.
    """
    wanted = [key for key in ("minutes", "accuracy") if budget.get(key) is not None]
    if len(wanted) > 1:
        raise UserError("budget: minutes and accuracy are both set; take one of them")
    return bool(wanted)


def not_measured(path: Path) -> UserError:
    """The error where there is no front to choose from."""
    return UserError(
        f"budget: {path} does not exist: speed against accuracy is to be measured first, without a budget.\n"
        f"Run: {_MEASURE} --output {path}"
    )


def choose(budget: Mapping[str, float | None], front: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """The most accurate point within a time, or the fastest that reaches an accuracy; by the means measured.

    Args:
        budget: ``minutes`` or ``accuracy``.
        front: content of ``front.json``.
        path: of that file, for messages.

    Raises:
        UserError: no point fits; tells the nearest.
    """
    points, limit = front["points"], budget.get("minutes")
    if limit is not None:
        fitting = [point for point in points if point["minutes"] <= limit]
        if fitting:
            return max(fitting, key=lambda point: (point["accuracy"], -point["minutes"]))
        raise _none_fits(f"minutes = {limit:g}", "as fast", min(points, key=lambda one: one["minutes"]), path)
    least = budget["accuracy"]
    fitting = [point for point in points if point["accuracy"] >= least]
    if fitting:
        return min(fitting, key=lambda point: (point["minutes"], -point["accuracy"]))
    raise _none_fits(
        f"accuracy = {least:g}", "as accurate", max(points, key=lambda one: one["accuracy"]), path
    )


def _none_fits(key: str, what: str, nearest: Mapping[str, Any], path: Path) -> UserError:
    return UserError(
        f"budget.{key}: no point of {path} is {what}.\nThe nearest is {nearest['label']}: {nearest['minutes']:g} "
        f"minutes, accuracy {nearest['accuracy']:g}"
    )
