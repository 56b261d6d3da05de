"""What a survey decides, in place of the configuration's ``auto``; an explicit value stands over it."""

from egosplat.pipeline.config import Config, merge
from egosplat.pipeline.survey_file import Survey

AUTO = "auto"


def leaves_frames_out(config: Config) -> bool:
    """Whether the stages that learn follow a survey's list of frames."""
    return config["survey"]["min_view_change_deg"] > 0


def masks_by_survey(config: Config) -> bool:
    """Whether a survey decides what is masked."""
    return config["splats"]["masking"] == AUTO


def decided(config: Config, survey: Survey) -> Config:
    """A configuration with what its survey decides in place of ``auto``."""
    if not masks_by_survey(config):
        return config
    return merge(config, {"splats": {"masking": survey["motion"]["masking"]}})
