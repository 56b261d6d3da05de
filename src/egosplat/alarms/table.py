"""The table of alarms, ``alarms.csv`` in this folder. Why each limit lies there is in docs/alarms.md."""

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Alarm:
    """A statistic of a stage's result outside of its normal range, a sign that the result is unusable.

    Attributes:
        key: stable code of stage and statistic, such as ``masks.pixels``.
        figures: what was measured, by the names that the sentences of the table use.
    """

    key: str
    figures: Mapping[str, float | str]


@dataclass(frozen=True)
class AlarmRow:
    """A row of ``alarms.csv``.

    Attributes:
        limit: the end of the normal range; None if it is not a constant: then any figures are an alarm.
        normal: the normal range in words, "up to" the limit where it lies below; in the file a format of the limit.
        sentence: a format of the figures.
        advice: what to do; in brackets, behind ``key=value:`` or ``key!=value:``, what can be done only there (``CONDITION``).
        causes: keys with which a preset or the user traded quality for time, and which may have caused it.
    """

    limit: float | None
    normal: str
    sentence: str
    advice: str
    causes: tuple[str, ...]

    def is_passed(self, statistic: float) -> bool:
        """Whether a statistic is beyond the limit; NaN is beyond a lower one."""
        assert self.limit is not None
        return statistic > self.limit if self.normal.startswith("up to") else not statistic >= self.limit


# Figures of an alarm: the keys of ``causes`` whose values are not the defaults, and its advice without what cannot be done.
CAUSES, ADVICE = "made_with", "advice"
CONDITION = re.compile(r"\[([a-z0-9_.]+)(!?=)(\w+): (.*?)\]")


def _read() -> dict[str, AlarmRow]:
    rows = {}
    with Path(__file__).with_name("alarms.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            limit = float(row["limit"]) if row["limit"] else None
            words = row["normal"].format(limit), row["sentence"], row["advice"]
            rows[row["key"]] = AlarmRow(limit, *words, tuple(row["causes"].split()))
    return rows


TABLE = _read()
