"""Alarms as lines of text."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from egosplat.alarms.table import CAUSES, TABLE, Alarm, Limit
from egosplat.pipeline.messages import figure
from egosplat.progress import NOTICE


@dataclass(frozen=True)
class _Beyond:
    """A statistic beyond its limit, which it stays when it is rounded for a sentence."""

    value: float
    limit: Limit

    def __format__(self, form: str) -> str:
        return figure(self.value, form, self.limit.is_passed)


def found_text(alarm: Alarm) -> str:
    """What was found, as a sentence on the figures of an alarm."""
    # JSON has no NaN; a file holds null in its place.
    figures: dict[str, Any] = {name: math.nan if x is None else x for name, x in alarm.figures.items()}
    row = TABLE[alarm.key]
    if row.limit.value is not None:
        figures["value"] = _Beyond(float(figures["value"]), row.limit)
    return row.sentence.format(**figures)


def alarm_line(alarm: Alarm) -> str:
    """The alarm in one line: key, what was found, the normal range, what may have caused it, and what to do."""
    causes = f"Made with {alarm.figures[CAUSES]}. " if CAUSES in alarm.figures else ""
    row = TABLE[alarm.key]
    return f"{alarm.key}: {found_text(alarm)} (normal: {row.limit.normal_range()}). {causes}{row.advice}"


def warning_lines(notice: str | None, alarms: Iterable[Alarm]) -> list[str]:
    """Format the notice on unsuitable models as ``notice: ...``, then each alarm as ``alarm: ...``."""
    return [
        *([] if notice is None else [f"{NOTICE}{notice}"]),
        *(f"alarm: {alarm_line(alarm)}" for alarm in alarms),
    ]
