"""Compute the alarms of artifacts, and tell them as lines of text."""

import math
from collections.abc import Iterable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.statistics import MEASURES, Figures
from egosplat.alarms.table import ADVICE, CAUSES, CONDITION, TABLE, Alarm, AlarmRow
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.config import section_keys, stage_sections
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log


def alarms_of(*artifacts: Artifact) -> list[Alarm]:
    """The alarms of artifacts, in the order of the stages."""
    order, alarms = list(STAGES), []
    for artifact in sorted(artifacts, key=lambda artifact: order.index(artifact.provenance["stage"])):
        for key, measure in MEASURES.items():
            if key.startswith(f"{artifact.schema.name}.") and (figures := measure(artifact)):
                alarms += find_alarm(key, figures, _made_with(TABLE[key], artifact))
    return alarms


def find_alarm(key: str, figures: Figures, made_with: Figures | None = None) -> list[Alarm]:
    """One alarm if the value among the figures of ``statistics`` is beyond its limit, else none; ``made_with`` is told, too."""
    row, made_with = TABLE[key], made_with or {}
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


def _made_with(row: AlarmRow, artifact: Artifact) -> Figures:
    """Keys that may have caused an alarm, with their values if these are not the defaults, and the advice that can be followed."""
    found = lineage([artifact]).found if row.causes or "[" in row.advice else {}

    def given(key: str) -> Any:
        section, name = key.split(".")
        # Several stages have a key of one name.
        made = (one.provenance for one in (artifact, *found.values()))
        has = (one["options"] for one in made if name in stage_sections(one["stage"]).get(section, ()))
        return next((options[name] for options in has if name in options), _default(key))

    causes = ", ".join(f"{key} {given(key)}" for key in row.causes if given(key) != _default(key))
    advice = CONDITION.sub(
        lambda part: part[4] * ((str(given(part[1])) == part[3]) == (part[2] == "=")), row.advice
    )
    return ({CAUSES: causes} if causes else {}) | ({ADVICE: advice} if "[" in row.advice else {})


def _default(key: str) -> Any:
    section, name = key.split(".")
    return section_keys(section)[name]["default"]


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
    return f"{alarm.key}: {found_text(alarm)} (normal: {TABLE[alarm.key].normal}). {advice_of(alarm)}"


def advice_of(alarm: Alarm) -> str:
    """What may have caused an alarm, and what to do."""
    advice = alarm.figures.get(ADVICE, CONDITION.sub(r"\4", TABLE[alarm.key].advice))
    return f"Made with {alarm.figures[CAUSES]}. {advice}" if CAUSES in alarm.figures else str(advice)


def warning_lines(notice: str | None, alarms: Iterable[Alarm]) -> list[str]:
    """Format the notice on unsuitable models as ``notice: ...``, then each alarm as ``alarm: ...``."""
    lines = [] if notice is None else [f"notice: {notice}"]
    return [*lines, *(f"alarm: {alarm_line(alarm)}" for alarm in alarms)]


def warnings_of(*artifacts: Artifact) -> list[str]:
    """The ``warning_lines`` of artifacts."""
    return warning_lines(notice_of_artifacts(artifacts), alarms_of(*artifacts))


def log_warnings(stage: str, output: Path, *, is_step: bool) -> None:
    """Log the ``warning_lines`` of a stage's artifact, if it writes one; the workflow tells the notice itself, once for all steps."""
    if stage in SCHEMAS:
        artifact = open_artifact(output, SCHEMAS[stage])
        notice = None if is_step else notice_of_artifacts([artifact])
        for line in warning_lines(notice, alarms_of(artifact)):
            log(line)
