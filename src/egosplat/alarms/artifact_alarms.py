"""Compute the alarms of artifacts, and tell them as lines of text."""

import math
import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.statistics import MEASURES, Figures
from egosplat.alarms.table import CAUSES, TABLE, Alarm, AlarmRow
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.config import section_keys
from egosplat.pipeline.stages import STAGES
from egosplat.progress import NOTICE, log


def alarms_of(*artifacts: Artifact) -> list[Alarm]:
    """The alarms of artifacts, in the order of the stages."""
    order, alarms = list(STAGES), []
    for artifact in sorted(artifacts, key=lambda artifact: order.index(artifact.provenance["stage"])):
        for key, measure in MEASURES.items():
            if key.startswith(f"{artifact.schema.name}.") and (figures := measure(artifact)):
                alarms += find_alarm(key, figures, _causes(TABLE[key], artifact))
    return alarms


def find_alarm(key: str, figures: Figures, causes: str = "") -> list[Alarm]:
    """One alarm if the value among the figures of ``statistics`` is beyond its limit, else none.

    ``causes`` are the keys with their values that may have caused it.
    """
    row, made_with = TABLE[key], {CAUSES: causes} if causes else {}
    if row.limit is None:
        return [Alarm(key, figures | made_with)]
    values = np.asarray(figures["value"], dtype=float)
    wrong = [row.is_passed(value) for value in values.ravel().tolist()]
    if not any(wrong):
        return []
    counts = {"wrong": sum(wrong), "frames": len(wrong)} if values.ndim else {}
    value = {"value": float(values.max()), "limit": row.limit}
    others = {name: other for name, other in figures.items() if name != "value"}
    return [Alarm(key, value | counts | others | made_with)]


def find_chance_alarm(score: Mapping[str, Any]) -> list[Alarm]:
    """An alarm if the accuracy's lower bound is not above the best answer that ignores the scene; from a group of scores."""
    lowest = score["accuracy_interval"] and score["accuracy_interval"][0]
    chance = max(score["random_pixel"], score["middle_pixel"])
    if lowest is None or lowest > chance:
        return []
    return [Alarm("metrics.chance", {"value": lowest, "limit": chance})]


def _causes(row: AlarmRow, artifact: Artifact) -> str:
    """The keys that may have caused an alarm, with their values, if these are not the defaults."""
    made_from = lineage([artifact]).found if row.causes else {}
    told = []
    for section, name in (cause.split(".") for cause in row.causes):
        given = made_from.get(f"{section}.zarr", artifact).provenance["options"]
        if name in given and given[name] != section_keys(section)[name]["default"]:
            told.append(f"{section}.{name} {given[name]}")
    return ", ".join(told)


class _Beyond(float):
    """A statistic beyond its limit, which it stays when it is rounded for a sentence."""

    row: AlarmRow

    def __format__(self, form: str) -> str:
        value, text = float(self), float.__format__(self, form)
        if not math.isfinite(value):
            return text
        scale, shown = 100 if text.endswith("%") else 1, Decimal(text.rstrip("%"))
        step = Decimal((0, (1,), int(shown.as_tuple().exponent)))
        near = (float(number) / scale for number in (shown, shown - step, shown + step))
        return format(
            next((n for n in near if self.row.is_passed(n) == self.row.is_passed(value)), value), form
        )


def found_text(alarm: Alarm) -> str:
    """What was found, as a sentence on the figures of an alarm."""
    # JSON has no NaN; a file holds null in its place.
    figures: dict[str, Any] = {name: math.nan if x is None else x for name, x in alarm.figures.items()}
    row = TABLE[alarm.key]
    if row.limit is not None:
        figures["value"] = _Beyond(figures["value"])
        figures["value"].row = row
    return row.sentence.format(**figures)


def alarm_line(alarm: Alarm) -> str:
    """The alarm in one line: key, what was found, the normal range, what may have caused it, and what to do."""
    causes = f"Made with {alarm.figures[CAUSES]}. " if CAUSES in alarm.figures else ""
    row = TABLE[alarm.key]
    advice = re.sub(r"\[(.*)\]", r"\1" if causes else "", row.advice)
    return f"{alarm.key}: {found_text(alarm)} (normal: {row.normal}). {causes}{advice}"


def warning_lines(notice: str | None, alarms: Iterable[Alarm]) -> list[str]:
    """Format the notice on unsuitable models as ``notice: ...``, then each alarm as ``alarm: ...``."""
    lines = [] if notice is None else [f"{NOTICE}{notice}"]
    return [*lines, *(f"alarm: {alarm_line(alarm)}" for alarm in alarms)]


def warnings_of(*artifacts: Artifact) -> list[str]:
    """The ``warning_lines`` of artifacts."""
    return warning_lines(notice_of_artifacts(artifacts), alarms_of(*artifacts))


def log_warnings(stage: str, output: Path) -> None:
    """Log the ``warning_lines`` of a stage's artifact; nothing if the stage writes no artifact."""
    if stage in SCHEMAS:
        for line in warnings_of(open_artifact(output, SCHEMAS[stage])):
            log(line)
