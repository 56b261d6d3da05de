"""The limits of the alarms: one row for each statistic. What they mean, and why they lie there, is in ``texts``."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial


@dataclass(frozen=True)
class Alarm:
    """A statistic of a stage's result outside of its normal range, a sign that the result is unusable.

    Attributes:
        key: stable code of stage and statistic, such as ``masks.pixels``.
        figures: what was measured, by the names that the sentences of ``texts`` use.
    """

    key: str
    figures: Mapping[str, float | str]


@dataclass(frozen=True)
class Limit:
    """The end of a statistic's normal range, which lies below the limit or above it."""

    value: float
    normal_is_below: bool

    def is_passed(self, statistic: float) -> bool:
        """Whether a statistic is beyond the limit; NaN is beyond a lower one."""
        return statistic > self.value if self.normal_is_below else not statistic >= self.value


_at_most, _at_least = (partial(Limit, normal_is_below=below) for below in (True, False))

LIMITS: dict[str, Limit] = {
    "frames.valid_pixels": _at_least(0.5),
    "frames.blurred": _at_most(0.1),
    "poses.registered": _at_least(0.9),
    "poses.reprojection": _at_most(1.0),
    "poses.parallax": _at_least(5.0),
    "poses.points": _at_least(20.0),
    "poses.models": _at_most(1),
    "segments.empty_pixels": _at_most(0.5),
    "segments.instances_per_frame": _at_least(3.0),
    "segments.frames_per_instance": _at_least(5.0),
    "instances.masks_kept": _at_least(0.4),
    "instances.empty_pixels": _at_most(0.15),
    "view_features.lost": _at_most(0.01),
    "features.outliers": _at_most(0.25),
    "features.agreement": _at_least(0.5),
    "features.reconstruction": _at_least(0.9),
    "transient.probability": _at_most(0.2),
    "masks.instances": _at_most(0.5),
    "masks.pixels": _at_most(0.25),
    "splats.psnr": _at_least(20.0),
    "splats.pose_correction": _at_most(0.05),
    "splats.gain": _at_most(2.5),
    "language.without_code": _at_most(0.25),
}


# Figure of an alarm that names the keys below whose values are not the defaults.
CAUSES = "made_with"

# Keys that may have caused what an alarm finds: a preset, or the user, traded quality for time with them.
CAUSING_KEYS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("segments.empty_pixels", "segments.instances_per_frame"), ("segments.points_per_side",)),
    **dict.fromkeys(("instances.masks_kept", "instances.empty_pixels"), ("instances.iterations",)),
    "features.reconstruction": ("features.dims",),
    "transient.probability": ("transient.transient_penalty", "transient.iterations"),
    **dict.fromkeys(("masks.instances", "masks.pixels"), ("masks.threshold",)),
    "splats.psnr": (
        *("camera.refine_poses", "camera.compensate_exposure"),
        *("splats.iterations", "splats.max_gaussians"),
    ),
}


def find_alarm(key: str, statistic: float | None, **figures: float | str) -> Iterator[Alarm]:
    """Yield an alarm if a statistic is beyond its limit; nothing for None, an unknown value.

    Args:
        figures: what else the alarm's sentence tells, beside ``value`` and ``limit``.
    """
    if statistic is not None and LIMITS[key].is_passed(statistic):
        yield Alarm(key, {"value": float(statistic), "limit": LIMITS[key].value, **figures})


def find_chance_alarm(lowest: float | None, chance: float) -> Iterator[Alarm]:
    """Yield an alarm if the accuracy's lower bound is not above the best answer that ignores the scene."""
    if lowest is not None and lowest <= chance:
        yield Alarm("metrics.chance", {"value": lowest, "limit": chance})
