"""An alarm: evidence in a stage's own figures that its result, and all that is made from it, is not to be trusted."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Alarm:
    """One figure beyond its limit.

    Attributes:
        key: stable code, the stage's name and what was measured: ``masks.pixels``.
        normal: the figure where the pipeline works.
        found: what was found instead.
        advice: what to do.
    """

    key: str
    normal: str
    found: str
    advice: str

    def __str__(self) -> str:
        return f"{self.key}: {self.found} (normal: {self.normal}). {self.advice}"


def exceeds(value: float | None, limit: float) -> bool:
    """Whether a figure is above a limit; a figure that is not told, None, is not."""
    return value is not None and value > limit


def falls_below(value: float | None, limit: float) -> bool:
    """Whether a figure is below a limit; a figure that is not told, None, is not."""
    return value is not None and value < limit


def warning_lines(notice: str | None, alarms: Iterable[Alarm]) -> list[str]:
    """The notice of models that do not fit as ``notice: ...``, then each alarm as ``alarm: ...``."""
    return [*([] if notice is None else [f"notice: {notice}"]), *(f"alarm: {alarm}" for alarm in alarms)]
