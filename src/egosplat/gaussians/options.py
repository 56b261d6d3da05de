"""Options that the stages with a training of Gaussians share."""

from typing import ClassVar, Literal

from egosplat.pipeline.options import Options


class CameraOptions(Options):
    """What the training of Gaussians corrects about the camera (docs/method.md#corrections)."""

    section: ClassVar[str] = "camera"

    refine_poses: Literal["auto", "on", "off"] = "auto"
    """Refine the pose of each training frame together with the Gaussians: a small rigid motion a frame, by gradient
    descent. It costs time and helps where poses are off by millimeters or more. auto: if the survey finds that the
    poses do not explain the pictures; by hand, as the given survey says, else off."""

    compensate_exposure: Literal["auto", "on", "off"] = "auto"
    """Give each training frame a gain of red, green and blue, which its render gets before it is compared. It helps
    where auto-exposure or white balance change; the Gaussians keep the mean exposure. auto: if the survey finds
    that the brightness of the same surfaces changes; by hand, as the given survey says, else off."""
