"""Compute the alarms of artifacts, and log them."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms import statistics
from egosplat.alarms.table import CAUSES, TABLE, Alarm
from egosplat.alarms.texts import warning_lines
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.config import section_keys
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log


def alarms_of(artifact: Artifact) -> list[Alarm]:
    """The alarms of one artifact; empty for a kind without alarms."""
    found = []
    for key, row in TABLE.items():
        if row.measure and key.startswith(f"{artifact.schema.name}.") and (figures := row.measure(artifact)):
            found += find_alarm(key, figures, _causes(key, artifact))
    return found


def find_alarm(key: str, figures: statistics.Figures, causes: str = "") -> list[Alarm]:
    """One alarm if the value among the figures of ``statistics`` is beyond its limit, else none.

    Args:
        causes: the keys with their values that may have caused it.
    """
    limit, made_with = TABLE[key].limit, {CAUSES: causes} if causes else {}
    if limit.value is None:
        return [Alarm(key, figures | made_with)]
    values = np.asarray(figures["value"], dtype=float)
    wrong = [limit.is_passed(value) for value in values.ravel().tolist()]
    if not any(wrong):
        return []
    counts = {"wrong": sum(wrong), "frames": len(wrong)} if values.ndim else {}
    others = {name: value for name, value in figures.items() if name != "value"}
    value = {"value": float(values.max()), "limit": limit.value}
    return [Alarm(key, value | counts | others | made_with)]


def find_chance_alarm(score: Mapping[str, Any]) -> list[Alarm]:
    """An alarm if the accuracy's lower bound is not above the best answer that ignores the scene; from a group of scores."""
    lowest = score["accuracy_interval"] and score["accuracy_interval"][0]
    chance = max(score["random_pixel"], score["middle_pixel"])
    if lowest is None or lowest > chance:
        return []
    return [Alarm("metrics.chance", {"value": lowest, "limit": chance})]


def _causes(key: str, artifact: Artifact) -> str:
    """The keys that may have caused an alarm, with their values, if these are not the defaults."""
    given = artifact.provenance["options"]
    names = (cause.split(".") for cause in TABLE[key].causes)
    return ", ".join(
        f"{section}.{name} {given[name]}"
        for section, name in names
        if name in given and given[name] != section_keys(section)[name]["default"]
    )


def alarms_of_all(artifacts: Iterable[Artifact]) -> list[Alarm]:
    """The alarms of several artifacts, in the order of the stages."""
    order = list(STAGES)
    ordered = sorted(artifacts, key=lambda artifact: order.index(artifact.provenance["stage"]))
    return [alarm for artifact in ordered for alarm in alarms_of(artifact)]


def warnings_of(*artifacts: Artifact) -> list[str]:
    """The ``warning_lines`` of artifacts."""
    return warning_lines(notice_of_artifacts(artifacts), alarms_of_all(artifacts))


def log_warnings(stage: str, output: Path) -> None:
    """Log the ``warning_lines`` of a stage's artifact; nothing if the stage writes no artifact."""
    if stage in SCHEMAS:
        for line in warnings_of(open_artifact(output, SCHEMAS[stage])):
            log(line)
