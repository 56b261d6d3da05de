"""Options of the stage ``survey``."""

from typing import Annotated

from pydantic import Field

from egosplat.pipeline.options import Natural, Options, Share


class SurveyOptions(Options):
    """Decisions that the frames and poses of a scene allow: whether what moves is masked, and which frames to train on. survey.json holds the evidence for each."""

    min_moving_share: Share = 0.01
    """Smallest share of the picture that keeps moving from which it is tracked and masked (for splats.masking and
    segments.track_moving auto). A quarter of it is enough of what moves and is not seen to move again, such as hands at
    work. Below both, the network, the masks and the tracks are left out: they take 1.4 to 1.8 times the time and change
    no score (benchmarks/survey/README.md). A scene in which motion cannot be measured is masked."""

    min_view_change_deg: Annotated[float, Field(ge=0, le=180)] = 3.0
    """Skip a training frame if the camera moved less than this (degrees of rotation plus parallax) since the last
    kept frame. At least one frame per second is kept. Larger is faster and gives fewer views. In a static scene the
    Gaussians train on all frames, because that takes no longer. 0 keeps all, and needs no survey."""

    cell_views: Natural = 600
    """Largest number of training frames that add a view in a cell. A recording with more is trained in cells, each by a job of its
    own with all the iterations and Gaussians of splats (docs/method.md#cells). 0, and without a survey: in one."""
