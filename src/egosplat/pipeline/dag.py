"""Which artifacts a stage reads, which flags it gets, and what a survey decides: functions of a configuration and a survey."""

import json
import shlex
from collections.abc import Mapping

from egosplat.pipeline.config import Config, merge, stage_values
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.survey_file import Survey, gaussians_learn_from_all

AUTO = "auto"

ALL_FRAMES = "all"

_MASKS: dict[str, tuple[str, ...]] = {
    "none": (),
    "initial": ("transient",),
    "refined": ("masks",),
    # The survey may choose any of the three; "masks" stands for the longest chain of stages.
    AUTO: ("masks",),
}
"""By splats.masking: the artifacts with the masks."""

_CODES: dict[str, tuple[str, ...]] = {"after": (), "joint": ("segments", "features")}
"""By splats.language: the artifacts from which codes are trained with the geometry."""


def leaves_frames_out(config: Config) -> bool:
    """Whether training follows the survey's list of frames."""
    return config["survey"]["min_view_change_deg"] > 0


def masks_by_survey(config: Config) -> bool:
    """Whether the survey decides what is masked."""
    return config["splats"]["masking"] == AUTO


def decided(config: Config, survey: Survey) -> Config:
    """The configuration with the survey's decisions in place of ``auto``."""
    if not masks_by_survey(config):
        return config
    return merge(config, {"splats": {"masking": survey["motion"]["masking"]}})


def inputs_of(stage: str, config: Config) -> tuple[str, ...]:
    """The stages whose artifacts a stage reads, with the survey where it decides which."""
    always = tuple(name for name in STAGES[stage].inputs if name in STAGES)
    found = always + optional_inputs_of(stage, config)
    by_survey = "masks" in STAGES[stage].optional and masks_by_survey(config) and "survey" not in found
    return (*found, "survey") if by_survey else found


def optional_inputs_of(stage: str, config: Config) -> tuple[str, ...]:
    """The optional inputs of a stage that a configuration asks for."""
    views = ("survey",) if leaves_frames_out(config) else ()
    wanted = views + _MASKS[config["splats"]["masking"]] + _CODES[config["splats"]["language"]]
    return tuple(name for name in wanted if name in STAGES[stage].optional)


def training_frames(stage: str, config: Config, survey: Survey) -> str:
    """Digest of the frames that a stage trains on, so that its rule reruns if these change; or ``ALL_FRAMES``."""
    if not leaves_frames_out(config):
        return ALL_FRAMES
    masking = decided(config, survey)["splats"]["masking"]
    if stage == "splats" and gaussians_learn_from_all(survey, masking):
        return ALL_FRAMES
    return survey["views"]["digest"]


def stage_flags(stage: str, config: Config) -> str:
    """The keys of a stage as command line flags, sorted by name. A key without a value has no flag."""
    keys = sorted(stage_values(stage, config).items())
    return " ".join(_flag(name, value) for name, value in keys if value is not None)


def input_flags(paths: Mapping[str, str]) -> str:
    """Optional inputs, by stage, as command line flags."""
    return " ".join(_flag(name, path) for name, path in paths.items())


def default_pages(masking: str) -> list[str]:
    """The files that a run without a target makes of a scene with such masks."""
    moving = ["transient.png"] if masking == "refined" else []
    pages = ["contact_sheet.png", "segments.png", "crops.png", *moving, "splats.png", "language.png"]
    return [*pages, "metrics.json", "queries.png"]


def _flag(name: str, value: object) -> str:
    name = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{name}" if value else f"--no-{name}"
    text = json.dumps(value) if isinstance(value, list) else str(value)
    return f"--{name} {shlex.quote(text)}"
