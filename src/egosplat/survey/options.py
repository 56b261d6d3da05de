"""Options of the stage ``survey``."""

from typing import Annotated

from pydantic import Field

from egosplat.pipeline.options import Options, Share


class SurveyOptions(Options):
    """Decisions that the frames and poses of a scene allow: whether it is static, and which frames to train on. survey.json holds the evidence for each."""

    max_moving_probability: Share = 0.5
    """A scene counts as static (for splats.masking auto) if the probability that something moves is smaller. Larger
    skips the network and the masks for scenes with little motion, which leaves artifacts in the Gaussians
    (benchmarks/survey/README.md). A scene in which motion cannot be measured counts as moving."""

    min_view_change_deg: Annotated[float, Field(ge=0, le=180)] = 3.0
    """Skip a training frame if the camera moved less than this (degrees of rotation plus parallax) since the last
    kept frame. At least one frame per second is kept. Larger is faster and gives fewer views. In a static scene the
    Gaussians train on all frames, because that takes no longer. 0 keeps all; if blur_limit is 0, too, no survey is
    needed."""

    blur_limit: Annotated[float, Field(ge=0)] = 4.0
    """Skip a training frame that is blurred where sharper frames show the same. The limit is a difference of
    sharpness in units of its scatter between frames with the same view, and never less than what a motion of 1.5
    pixels during the exposure costs (docs/method.md#sharpness). Larger keeps more blurred frames. 0 keeps all."""
