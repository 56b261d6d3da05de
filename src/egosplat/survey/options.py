"""Options of the stage ``survey``."""

from typing import Annotated

from pydantic import Field

from egosplat.pipeline.options import Options, Share


class SurveyOptions(Options):
    """Decisions that the frames and poses of a scene allow: whether what moves is masked, and which frames to train on. survey.json holds the evidence for each."""

    min_moving_share: Share = 0.008
    """Smallest share of the picture that keeps moving from which it is tracked and masked (for splats.masking and
    segments.track_moving auto). Below it the network, the masks and the tracks are left out: they cost a quarter of
    the time and change no score (benchmarks/ablation/README.md). A scene in which motion cannot be measured is masked."""

    min_view_change_deg: Annotated[float, Field(ge=0, le=180)] = 3.0
    """Skip a training frame if the camera moved less than this (degrees of rotation plus parallax) since the last
    kept frame. At least one frame per second is kept. Larger is faster and gives fewer views. In a static scene the
    Gaussians train on all frames, because that takes no longer. 0 keeps all, and needs no survey."""
