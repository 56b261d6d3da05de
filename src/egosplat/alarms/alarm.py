"""An alarm: a statistic of a stage's result outside of its normal range, a sign that the result is unusable."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Alarm:
    """A statistic outside of its normal range.

    Attributes:
        key: stable code of stage and statistic, such as ``masks.pixels``.
    """

    key: str
    normal: str
    found: str
    advice: str

    def __str__(self) -> str:
        return f"{self.key}: {self.found} (normal: {self.normal}). {self.advice}"


def exceeds(value: float | None, limit: float) -> bool:
    """Whether a value is above a limit; False for None, an unknown value."""
    return value is not None and value > limit


def falls_below(value: float | None, limit: float) -> bool:
    """Whether a value is below a limit; False for None, an unknown value."""
    return value is not None and value < limit


def warning_lines(notice: str | None, alarms: Iterable[Alarm]) -> list[str]:
    """Format the notice on unsuitable models as ``notice: ...``, then each alarm as ``alarm: ...``."""
    return [*([] if notice is None else [f"notice: {notice}"]), *(f"alarm: {alarm}" for alarm in alarms)]
