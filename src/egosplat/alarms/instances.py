"""Alarms of the stages that find instances and what they mean: segments, view_features and features."""

from collections.abc import Iterator

from egosplat.alarms.alarm import Alarm, exceeds, falls_below

MAX_EMPTY_PIXELS = 0.5
"""Share of valid pixels without an instance. In synthetic apartments a level leaves 1 to 25 % without (the last with
prompts in the first frame alone, benchmarks/segments/README.md); 10 % have none at any level, in two series of photographs 4 and
6 %."""

MIN_INSTANCES_PER_FRAME = 3.0
"""One a level. A synthetic apartment has 38, two series of photographs 28 and 63."""

MIN_FRAMES_PER_INSTANCE = 5.0
"""Outliers are told apart from three views on; benchmarks/aggregation/README.md has things with 6 to 48 views. Of 48 frames of a synthetic apartment it is 31."""

MAX_LOST_VIEWS = 0.01
"""Share of the views without a finite feature. None is lost in float32."""

MAX_OUTLIERS = 0.25
"""Share of the views. The median absolute deviation tells outliers up to a share of 30 to 40 %
(benchmarks/aggregation/README.md); the limit lies below, and above the few per cent that chance leaves out."""

MIN_AGREEMENT = 0.5
"""See ``agreement_of``: half way between the views of different instances and equal ones. It is 0.68 and 0.76 in synthetic
apartments; with the small checkpoints, 0.55 and 0.48 in two series of photographs, which they do not know."""

MIN_RECONSTRUCTION = 0.9
"""Mean cosine. Codes of 16 numbers reach 0.98; at 0.88 every third thing that its features name is named something
else, at 0.92 every fourth (benchmarks/aggregation/README.md)."""

_MODEL = "set models.sam2_config and models.sam2_checkpoint to a SAM2 that knows such pictures"


def segments_alarms(
    empty_pixels: float | None,
    instances_per_frame: float | None,
    frames_per_instance: float | None,
) -> Iterator[Alarm]:
    """Alarms of instances followed through the video.

    Args:
        empty_pixels: share of valid pixels without an instance at any level.
        instances_per_frame, frames_per_instance: means.
    """
    if exceeds(empty_pixels, MAX_EMPTY_PIXELS):
        yield Alarm(
            "segments.empty_pixels",
            f"up to {MAX_EMPTY_PIXELS:.0%}",
            f"{empty_pixels:.1%} of the pixels belong to no instance",
            f"Nothing there can be asked for: look at segments.png and {_MODEL}",
        )
    if falls_below(instances_per_frame, MIN_INSTANCES_PER_FRAME):
        yield Alarm(
            "segments.instances_per_frame",
            f"{MIN_INSTANCES_PER_FRAME:g} or more",
            f"a frame shows {instances_per_frame:.1f} instances in the mean",
            f"Look at segments.png and {_MODEL}",
        )
    if falls_below(frames_per_instance, MIN_FRAMES_PER_INSTANCE):
        yield Alarm(
            "segments.frames_per_instance",
            f"{MIN_FRAMES_PER_INSTANCE:g} or more",
            f"an instance is followed through {frames_per_instance:.1f} frames in the mean",
            "Tracks break, and there are no views to aggregate: take a smaller frames.stride, or a longer recording",
        )


def view_features_alarms(lost: int, views: int) -> Iterator[Alarm]:
    """Args: lost: views of which the model makes no finite feature; views: those with one."""
    if lost and exceeds(lost / (lost + views), MAX_LOST_VIEWS):
        yield Alarm(
            "view_features.lost",
            "none",
            f"of {lost} of {lost + views} views the model makes no finite feature",
            "Set models.precision to float32, or take another models.clip_checkpoint",
        )


def features_alarms(
    outliers: int, views: int, agreement: float | None, spread: float | None, reconstruction: float | None
) -> Iterator[Alarm]:
    """Alarms of what instances mean.

    Args:
        outliers: views that disagree with their instance; views: of all.
        agreement: mean cosine of a view with its instance's consistent feature.
        spread: mean cosine between different instances' consistent features.
        reconstruction: mean cosine of a feature with what its code is decoded to.
    """
    if views and exceeds(outliers / views, MAX_OUTLIERS):
        yield Alarm(
            "features.outliers",
            f"up to {MAX_OUTLIERS:.0%}",
            f"{outliers} of {views} views disagree with their instance",
            _TRACKS,
        )
    if (
        agreement is not None
        and spread is not None
        and falls_below(agreement_of(agreement, spread), MIN_AGREEMENT)
    ):
        yield Alarm(
            "features.agreement",
            f"{MIN_AGREEMENT:g} or more, of 0 (as views of different instances) to 1 (equal)",
            f"views of an instance agree by {agreement_of(agreement, spread):.2f}: their mean cosine with it is "
            f"{agreement:.2f}, between instances {spread:.2f}",
            _TRACKS,
        )
    if falls_below(reconstruction, MIN_RECONSTRUCTION):
        yield Alarm(
            "features.reconstruction",
            f"{MIN_RECONSTRUCTION:g} or more",
            f"codes are decoded to features with a mean cosine of {reconstruction:.2f} to their own",
            "Codes lose what tells instances apart: raise features.dims, or set it to auto",
        )


def agreement_of(agreement: float, spread: float) -> float:
    """0 where views are as unlike their instance as different instances are each other, 1 where they are equal to it."""
    return (agreement - spread) / (1.0 - spread) if spread < 1.0 else 1.0


_TRACKS = (
    "Tracks change from one thing to another, or OpenCLIP does not know what they show: look at crops.png, and take "
    "other models.sam2_checkpoint and models.clip_checkpoint"
)
