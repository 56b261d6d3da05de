"""The words of the alarms: statistic, reason of the limit, sentence and advice.

Only pages and logs import this module, and the code hash leaves it out: a better sentence makes no stage stale.
``python -m egosplat.alarms.texts`` prints the table of docs/alarms.md.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from egosplat.alarms.limits import CAUSES, LIMITS, Alarm, Limit
from egosplat.pipeline.messages import figure
from egosplat.progress import NOTICE


@dataclass(frozen=True)
class Text:
    """The words of an alarm.

    Attributes:
        statistic: what is measured.
        limit: format of the limit, or the whole normal range if the limit is not a constant.
        reason: why the limit lies there.
        found: sentence on the figures of an alarm, as a format of them.
        advice: what to do.
    """

    statistic: str
    limit: str
    reason: str
    found: str
    advice: str


_EMPTY = "{value:.1%} of the pixels belong to no instance"
_MODEL = (
    "raise segments.points_per_side, which preset draft lowers, and set models.set to published, for a SAM2 trained "
    "on photographs"
)
_MERGING = (
    "Check the poses, and instances.png; raise splats.iterations, which preset draft lowers (instances.iterations where "
    "something moves; neither changes a given splat), or set segments.prompting to key_frames, which tracks in 2D"
)
_TRACKS = (
    "Tracks switch between objects, or OpenCLIP does not know them. Check crops.png, and use another "
    "models.sam2_checkpoint and models.clip_checkpoint"
)
_LESS = "Check transient.png; raise masks.threshold, which preset paper lowers, or set splats.masking to none if nothing moves"

TEXTS: dict[str, Text] = {
    "frames.valid_pixels": Text(
        "share of an image that shows the scene",
        "{:.0%}",
        "the lens circle leaves 70 to 80 % of a rectified Aria image; other recordings have no border",
        "{value:.1%} of an image's pixels show the scene",
        "Check contact_sheet.png. Raise frames.focal, which crops the border",
    ),
    "frames.blurred": Text(
        "share of the frames that are blank, or far less sharp than the recording's median",
        "{:.0%}",
        "none in a synthetic apartment and two series of photographs; one in ten leaves gaps in a trajectory",
        "{value:.1%} of the frames are blurred or blank, compared with the others",
        "Training gains little from them, and they may get no pose. Exclude them (frames.start_s, frames.end_s), or move the "
        "camera slower",
    ),
    "poses.registered": Text(
        "share of the frames with a pose",
        "{:.0%}",
        "COLMAP finds all in five synthetic apartments and in two series of photographs",
        "{value:.1%} of the frames have a pose",
        "The others are not used; the log of poses lists them. Record sharper frames, or reduce frames.stride",
    ),
    "poses.reprojection": Text(
        "mean reprojection error over the observations of COLMAP's points",
        "{:g} px",
        "0.25 to 0.30 px in synthetic apartments, 0.35 to 0.81 px in photographs; more means wrong matches",
        "the mean reprojection error is {value:.2f} px",
        "The poses are inexact. Check the calibration, rolling shutter and motion blur",
    ),
    "poses.parallax": Text(
        "angle under which the median point sees all cameras; poses of COLMAP and of files",
        "{:g}°",
        "64 and 65° in two series of photographs, 3.5 and 5.4° in videos of a camera that hardly moves",
        "the median point sees all cameras within {value:.2g}°: the camera hardly moves, and depth cannot be told",
        "Record with a camera that walks around, at least a tenth of the way to what it shows",
    ),
    "poses.points": Text(
        "points of COLMAP or of a file of poses, for each frame with a pose",
        "{:g}",
        "120 and 143 in two series of photographs, 14 in a video of a camera that hardly moves",
        "the scene has {points} points, {value:.1f} for each frame",
        "The Gaussians start from few places. Move the camera farther, record sharper or better lit frames, or raise "
        "frames.resolution; neighbors that show the same (frames.stride) add none",
    ),
    "poses.models": Text(
        "number of COLMAP's models with frames that no larger one has, which share too few to be joined",
        "{:g}",
        "only the largest is used",
        "COLMAP finds {value:.0f} unconnected models of {frames} frames",
        "Only the largest is used; the log of poses says which frames and why. Record the ways between the parts, or make "
        "each part a separate scene",
    ),
    "segments.empty_pixels": Text(
        "share of the valid pixels without an instance at any level",
        "{:.0%}",
        "1 to 25 % at a level in synthetic apartments, 10 % at all levels together; 4 and 6 % in two "
        "series of photographs",
        _EMPTY,
        f"Queries find nothing there. Check instances.png, and {_MODEL}",
    ),
    "segments.instances_per_frame": Text(
        "mean instances per frame",
        "{:g}",
        "one per level; a synthetic apartment has 38, two series of photographs 28 and 63",
        "frames have {value:.1f} instances on average",
        f"Check instances.png, and {_MODEL}",
    ),
    "segments.frames_per_instance": Text(
        "mean frames per instance; not with segments.prompting each_frame, which tracks nothing",
        "{:g}",
        "outlier detection needs three views; a synthetic apartment of 48 frames has a mean of 31",
        "instances are tracked for {value:.1f} frames on average",
        "Tracks break, and there are too few views to aggregate. Reduce frames.stride, or use a longer recording",
    ),
    "instances.masks_kept": Text(
        "share of the masks of single frames that belong to an instance that was merged in 3D",
        "{:.0%}",
        "66 % in a synthetic apartment, 47 % with poses that are wrong by 20 cm and 8 degrees, 18 % without merging",
        "{kept} of {masks} masks belong to an instance",
        f"Masks of different frames do not agree in 3D. {_MERGING}",
    ),
    "instances.empty_pixels": Text(
        "share of the valid pixels without an instance at any level after merging",
        "{:.0%}",
        "below 0.1 % in a synthetic apartment, 3 % with the poses of other frames, 24 % without merging",
        _EMPTY,
        f"Queries find nothing there. {_MERGING}",
    ),
    "view_features.lost": Text(
        "share of the views without a finite feature",
        "{:.0%}",
        "none in float32",
        "{lost} of {views} views have no finite feature",
        "Set run.precision to float32, or use another models.clip_checkpoint",
    ),
    "features.outliers": Text(
        "share of the views that disagree with their instance",
        "{:.0%}",
        "outliers are detected up to a share of 30 to 40 % (benchmarks/aggregation); a few per cent are "
        "dropped by chance",
        "{outliers} of {views} views disagree with their instance",
        _TRACKS,
    ),
    "features.agreement": Text(
        "agreement of views with their instance, from 0 (like views of different instances) to 1 (equal)",
        "{:g}",
        "the middle of the range; 0.68 and 0.76 in synthetic apartments, 0.55 and 0.48 in two series of photographs",
        "views agree with their instance by {value:.2f}: the mean cosine with it is {cosine:.2f}, between instances "
        "{spread:.2f}",
        _TRACKS,
    ),
    "features.reconstruction": Text(
        "mean cosine between features and their decoded codes",
        "{:g}",
        "at 0.88 one object in three gets another name than from its full features, at 0.92 one in four",
        "decoded codes have a mean cosine of {value:.2f} with their features",
        "Codes lose the differences between instances. Raise features.dims, which preset paper lowers, or set it to auto",
    ),
    "transient.probability": Text(
        "mean probability of being transient, over all pixels of all frames",
        "{:g}",
        "0.02 to 0.11 in apartments and still photographs, 0.47 where the network failed; the limit is "
        "the geometric mean",
        "the mean probability of a transient pixel is {value:.2f}",
        "The network classifies static pixels as transient. Check transient.png; raise transient.transient_penalty, "
        "which preset paper lowers, or transient.iterations, or set splats.masking to none if nothing moves",
    ),
    "masks.withheld": Text(
        "the network's mean probability, or the share of the instances that look transient; above the limit nothing is masked",
        "up to masks.max_share",
        "0.02 to 0.11, and 7 to 24 % of the instances",
        "nothing is masked: the network's mean probability is {probability:.2f}, and {transient} of {instances} instances "
        "look transient",
        "Check transient.png: blurred frames, wrong poses and changing exposure look like motion. Set splats.masking to none "
        "if nothing moves",
    ),
    "masks.instances": Text(
        "share of the instances that are masked",
        "{:.0%}",
        "most of a scene must be static for a reconstruction from a moving camera",
        "{transient} of {instances} instances are masked as moving",
        _LESS,
    ),
    "masks.pixels": Text(
        "share of all pixels of all frames that are masked",
        "{:.0%}",
        "1 to 4 % in synthetic apartments with people, 8 % for the network's masks without refinement",
        "{value:.1%} of all pixels are masked and excluded from training",
        _LESS,
    ),
    "splats.psnr": Text(
        "mean PSNR of the held-out frames",
        "{:g} dB",
        "20 dB is an error of a tenth of the range; 26 to 30 dB in synthetic apartments, 22.7 dB for 17 "
        "photographs of a desk",
        "the mean PSNR of held-out frames is {value:.2f} dB",
        "Check splats.png and the poses. Where camera.refine_poses or camera.compensate_exposure is off, as in presets draft "
        "and paper, set it to on; raise splats.iterations and splats.max_gaussians, which preset draft lowers",
    ),
    "splats.pose_correction": Text(
        "largest correction of a pose, as an angle in radians: of the rotation, or of the translation at the scene's median "
        "depth",
        "{:g}",
        "drift of 20 mm and 0.5 degrees is corrected by a fifth of it; beyond, gradient descent may end "
        "at any place that looks alike",
        "training moved the poses of {wrong} of {frames} frames farther, of frame {frame} by {shift_mm:.0f} mm and "
        "{turn_deg:.1f} degrees at a depth of {depth_m:.3g} m",
        "Check splats.png and the poses, or set camera.refine_poses to off",
    ),
    "splats.gain": Text(
        "largest gain of a frame's color, or its inverse",
        "{:g}",
        "auto-exposure over 4 stops changes sRGB values by a factor of about 2",
        "the gains of {wrong} of {frames} frames are outside, of frame {frame} {red:.2f}, {green:.2f}, {blue:.2f}",
        "Those frames are nearly black or white. Check them in frames.zarr, or set camera.compensate_exposure to off",
    ),
    "language.without_code": Text(
        "share of the Gaussians without a code at any level",
        "{:.0%}",
        "below 2 %: a Gaussian is seen in many frames",
        "{value:.1%} of the Gaussians have no code at any level",
        "Queries find nothing there. Check instances.png for pixels without an instance",
    ),
    "metrics.chance": Text(
        "lower end of the interval of the accuracy over all queries",
        "above the accuracy of a random pixel and of the image's middle",
        "the answers may be chance",
        "the accuracy may be as low as {value:.1%}; an answer that ignores the scene reaches {limit:.1%}",
        "The answers may be chance. Check queries.png and the other alarms",
    ),
}


def normal_range(key: str) -> str:
    """The normal range of an alarm's statistic, in words."""
    if key not in LIMITS:
        return TEXTS[key].limit
    limit = TEXTS[key].limit.format(LIMITS[key].value)
    return f"up to {limit}" if LIMITS[key].normal_is_below else f"{limit} or more"


@dataclass(frozen=True)
class _Beyond:
    """A statistic beyond its limit, which it stays when it is rounded for a sentence."""

    value: float
    limit: Limit

    def __format__(self, form: str) -> str:
        return figure(self.value, form, self.limit.is_passed)


def found_text(alarm: Alarm) -> str:
    """What was found, as a sentence on the figures of an alarm."""
    # JSON has no NaN; a file holds null in its place.
    figures: dict[str, Any] = {name: math.nan if one is None else one for name, one in alarm.figures.items()}
    if alarm.key in LIMITS:
        figures["value"] = _Beyond(float(figures["value"]), LIMITS[alarm.key])
    return TEXTS[alarm.key].found.format(**figures)


def alarm_line(alarm: Alarm) -> str:
    """The alarm in one line: key, what was found, the normal range, what may have caused it, and what to do."""
    causes = f"Made with {alarm.figures[CAUSES]}. " if CAUSES in alarm.figures else ""
    return f"{alarm.key}: {found_text(alarm)} (normal: {normal_range(alarm.key)}). {causes}{TEXTS[alarm.key].advice}"


def warning_lines(notice: str | None, alarms: Iterable[Alarm]) -> list[str]:
    """Format the notice on unsuitable models as ``notice: ...``, then each alarm as ``alarm: ...``."""
    return [
        *([] if notice is None else [f"{NOTICE}{notice}"]),
        *(f"alarm: {alarm_line(alarm)}" for alarm in alarms),
    ]


def alarm_table() -> str:
    """The table of docs/alarms.md."""
    head = ["| key | what is measured | normal | why the limit lies there | what to do |", "|" + " --- |" * 5]
    rows = (
        f"| `{key}` | {text.statistic} | {normal_range(key)} | {text.reason} | {text.advice} |"
        for key, text in TEXTS.items()
    )
    return "\n".join([*head, *rows])


if __name__ == "__main__":
    print(alarm_table())
