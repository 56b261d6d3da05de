"""The alarms: one row each. What each measures and why its limit lies there is in docs/alarms.md.

The code hash leaves the words of a row out: a better sentence makes no stage stale.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from egosplat.alarms import statistics
from egosplat.artifacts.reader import Artifact


@dataclass(frozen=True)
class Alarm:
    """A statistic of a stage's result outside of its normal range, a sign that the result is unusable.

    Attributes:
        key: stable code of stage and statistic, such as ``masks.pixels``.
        figures: what was measured, by the names that the sentences of the table use.
    """

    key: str
    figures: Mapping[str, float | str]


@dataclass(frozen=True)
class Limit:
    """The end of a statistic's normal range, which lies below the limit or above it.

    Attributes:
        value: None if it is not a constant: then any figures are an alarm.
        shown: format of the value, or the whole normal range if it is not a constant.
    """

    value: float | None
    shown: str
    normal_is_below: bool = True

    def is_passed(self, statistic: float) -> bool:
        """Whether a statistic is beyond the limit; NaN is beyond a lower one."""
        if self.value is None:
            return True
        return statistic > self.value if self.normal_is_below else not statistic >= self.value

    def normal_range(self) -> str:
        """The normal range in words."""
        if self.value is None:
            return self.shown
        shown = self.shown.format(self.value)
        return f"up to {shown}" if self.normal_is_below else f"{shown} or more"


@dataclass(frozen=True)
class AlarmRow:
    """An alarm: how to measure an artifact, a format of the figures, what to do, and the keys that may have caused it, with which
    a preset or the user traded quality for time.
    """

    measure: Callable[[Artifact], statistics.Figures | None] | None
    limit: Limit
    sentence: str
    advice: str
    causes: tuple[str, ...] = ()


# Figure of an alarm that names the keys of ``causes`` whose values are not the defaults.
CAUSES = "made_with"

at_most, at_least = (partial(Limit, normal_is_below=below) for below in (True, False))

_EMPTY = "{value:.1%} of the pixels belong to no instance"
_MODEL = (
    "raise segments.points_per_side, which preset draft lowers, and set models.set to published, for a SAM2 trained "
    "on photographs"
)
_MERGING = (
    "Check the poses, and instances.png; raise splats.iterations, which preset draft lowers (instances.iterations where "
    "something moves; neither changes a given splat)"
)
_TRACKS = (
    "Tracks switch between objects, or OpenCLIP does not know them. Check crops.png, and use another "
    "models.sam2_checkpoint and models.clip_checkpoint"
)
_LESS = "Check transient.png; raise masks.threshold, which preset paper lowers, or set splats.masking to none if nothing moves"

TABLE: dict[str, AlarmRow] = {
    "frames.valid_pixels": AlarmRow(
        statistics.mean("valid"),
        at_least(0.5, "{:.0%}"),
        "{value:.1%} of an image's pixels show the scene",
        "Check contact_sheet.png. Raise frames.focal, which crops the border",
    ),
    "frames.blurred": AlarmRow(
        statistics.blurred_frames,
        at_most(0.1, "{:.0%}"),
        "{value:.1%} of the frames are blurred or blank, compared with the others",
        "Training gains little from them, and they may get no pose. Exclude them (frames.start_s, frames.end_s), or move the "
        "camera slower",
    ),
    "poses.registered": AlarmRow(
        statistics.mean("registered"),
        at_least(0.9, "{:.0%}"),
        "{value:.1%} of the frames have a pose",
        "The others are not used; the log of poses lists them. Record sharper frames, or reduce frames.stride",
    ),
    "poses.reprojection": AlarmRow(
        statistics.fact("notes", "reprojection_error_px"),
        at_most(1.0, "{:g} px"),
        "the mean reprojection error is {value:.2f} px",
        "The poses are inexact. Check the calibration, rolling shutter and motion blur",
    ),
    "poses.parallax": AlarmRow(
        statistics.fact("notes", "parallax_deg"),
        at_least(5.0, "{:g}°"),
        "the median point sees all cameras within {value:.2g}°: the camera hardly moves, and depth cannot be told",
        "Record with a camera that walks around, at least a tenth of the way to what it shows",
    ),
    "poses.points": AlarmRow(
        statistics.points_per_frame,
        at_least(20.0, "{:g}"),
        "the scene has {points} points, {value:.1f} for each frame",
        "The Gaussians start from few places. Move the camera farther, record sharper or better lit frames, or raise "
        "frames.resolution; neighbors that show the same (frames.stride) add none",
    ),
    "poses.models": AlarmRow(
        statistics.unconnected_models,
        at_most(1, "{:g}"),
        "COLMAP finds {value:.0f} unconnected models of {frames} frames",
        "Only the largest is used; the log of poses says which frames and why. Record the ways between the parts, or make "
        "each part a separate scene",
    ),
    "segments.empty_pixels": AlarmRow(
        statistics.fact("pixels_without_instance"),
        at_most(0.5, "{:.0%}"),
        _EMPTY,
        f"Queries find nothing there. Check instances.png, and {_MODEL}",
        causes=("segments.points_per_side",),
    ),
    "segments.instances_per_frame": AlarmRow(
        statistics.fact("instances_per_frame"),
        at_least(3.0, "{:g}"),
        "frames have {value:.1f} instances on average",
        f"Check instances.png, and {_MODEL}",
        causes=("segments.points_per_side",),
    ),
    "segments.frames_per_instance": AlarmRow(
        statistics.fact("frames_per_instance"),
        at_least(5.0, "{:g}"),
        "instances are tracked for {value:.1f} frames on average",
        "Tracks break, and there are too few views to aggregate. Reduce frames.stride, or use a longer recording",
    ),
    "instances.masks_kept": AlarmRow(
        statistics.masks_kept,
        at_least(0.4, "{:.0%}"),
        "{kept} of {masks} masks belong to an instance",
        f"Masks of different frames do not agree in 3D. {_MERGING}",
        causes=("instances.iterations",),
    ),
    "instances.empty_pixels": AlarmRow(
        statistics.fact("pixels_without_instance"),
        at_most(0.15, "{:.0%}"),
        _EMPTY,
        f"Queries find nothing there. {_MERGING}",
        causes=("instances.iterations",),
    ),
    "view_features.lost": AlarmRow(
        statistics.lost_views,
        at_most(0.01, "{:.0%}"),
        "{lost} of {views} views have no finite feature",
        "Set run.precision to float32, or use another models.clip_checkpoint",
    ),
    "features.outliers": AlarmRow(
        statistics.outlying_views,
        at_most(0.25, "{:.0%}"),
        "{outliers} of {views} views disagree with their instance",
        _TRACKS,
    ),
    "features.agreement": AlarmRow(
        statistics.agreement,
        at_least(0.5, "{:g}"),
        "views agree with their instance by {value:.2f}: the mean cosine with it is {cosine:.2f}, between instances "
        "{spread:.2f}",
        _TRACKS,
    ),
    "features.reconstruction": AlarmRow(
        statistics.fact("reconstruction", "mean"),
        at_least(0.9, "{:g}"),
        "decoded codes have a mean cosine of {value:.2f} with their features",
        "Codes lose the differences between instances. Raise features.dims, which preset paper lowers, or set it to auto",
        causes=("features.dims",),
    ),
    "transient.probability": AlarmRow(
        statistics.fact("mean_probability"),
        at_most(0.2, "{:g}"),
        "the mean probability of a transient pixel is {value:.2f}",
        "The network classifies static pixels as transient. Check transient.png; raise transient.transient_penalty, "
        "which preset paper lowers, or transient.iterations, or set splats.masking to none if nothing moves",
        causes=("transient.transient_penalty", "transient.iterations"),
    ),
    "masks.withheld": AlarmRow(
        statistics.withheld,
        Limit(None, "up to masks.max_share"),
        "nothing is masked: the network's mean probability is {probability:.2f}, and {transient} of {instances} instances "
        "look transient",
        "Check transient.png: blurred frames, wrong poses and changing exposure look like motion. Set splats.masking to none "
        "if nothing moves",
    ),
    "masks.instances": AlarmRow(
        statistics.transient_instances,
        at_most(0.5, "{:.0%}"),
        "{transient} of {instances} instances are masked as moving",
        _LESS,
        causes=("masks.threshold",),
    ),
    "masks.pixels": AlarmRow(
        statistics.fact("masked_share"),
        at_most(0.25, "{:.0%}"),
        "{value:.1%} of all pixels are masked and excluded from training",
        _LESS,
        causes=("masks.threshold",),
    ),
    "splats.psnr": AlarmRow(
        statistics.mean("held_out/psnr"),
        at_least(20.0, "{:g} dB"),
        "the mean PSNR of held-out frames is {value:.2f} dB",
        "Check splats.png and the poses. Where camera.refine_poses or camera.compensate_exposure is off, as in presets draft "
        "and paper, set it to on; raise splats.iterations and splats.max_gaussians, which preset draft lowers",
        causes=(
            "camera.refine_poses",
            "camera.compensate_exposure",
            "splats.iterations",
            "splats.max_gaussians",
        ),
    ),
    "splats.pose_correction": AlarmRow(
        statistics.largest_pose_correction,
        at_most(0.05, "{:g}"),
        "training moved the poses of {wrong} of {frames} frames farther, of frame {frame} by {shift_mm:.0f} mm and "
        "{turn_deg:.1f} degrees at a depth of {depth_m:.3g} m",
        "Check splats.png and the poses, or set camera.refine_poses to off",
    ),
    "splats.gain": AlarmRow(
        statistics.largest_gain,
        at_most(2.5, "{:g}"),
        "the gains of {wrong} of {frames} frames are outside, of frame {frame} {red:.2f}, {green:.2f}, {blue:.2f}",
        "Those frames are nearly black or white. Check them in frames.zarr, or set camera.compensate_exposure to off",
    ),
    "language.without_code": AlarmRow(
        statistics.gaussians_without_code,
        at_most(0.25, "{:.0%}"),
        "{value:.1%} of the Gaussians have no code at any level",
        "Queries find nothing there. Check instances.png for pixels without an instance",
    ),
    "metrics.chance": AlarmRow(
        None,
        Limit(None, "above the accuracy of a random pixel and of the image's middle"),
        "the accuracy may be as low as {value:.1%}; an answer that ignores the scene reaches {limit:.1%}",
        "The answers may be chance. Check queries.png and the other alarms",
    ),
}
