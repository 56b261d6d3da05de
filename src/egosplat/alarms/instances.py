"""Alarms of the stages segments, instances, view_features and features."""

from collections.abc import Iterator

from egosplat.alarms.alarm import Alarm, exceeds, falls_below

# In synthetic apartments it is 1 to 25 % at a level (25 % with prompts in the first frame only,
# benchmarks/segments/README.md) and 10 % at all levels together; in two series of photographs 4 and 6 %.
# Share of valid pixels without an instance at any level.
MAX_EMPTY_PIXELS = 0.5

# A synthetic apartment has 38, two series of photographs 28 and 63.
# Mean instances per frame: one per level.
MIN_INSTANCES_PER_FRAME = 3.0

# Outlier detection needs three views. The objects of benchmarks/aggregation/README.md have 6 to 48 views; a synthetic apartment of 48 frames has
# a mean of 31.
# Mean frames per instance.
MIN_FRAMES_PER_INSTANCE = 5.0

# In a synthetic apartment it is 66 % (the rest are masks of what others show better), 47 % with poses that are wrong by 20 cm
# and 8 degrees, 20 % with the poses of other frames, and 18 % without merging.
# Share of the masks of single frames that belong to an instance that was merged in 3D.
MIN_MASKS_KEPT = 0.4

# In a synthetic apartment it is below 0.1 %, with the poses of other frames 3 %, and 24 % without merging.
# Share of valid pixels without an instance at any level after merging.
MAX_EMPTY_AFTER_MERGING = 0.15

# In float32 it is 0.
# Share of the views without a finite feature.
MAX_LOST_VIEWS = 0.01

# The median absolute deviation detects outliers up to a share of 30 to 40 %
# (benchmarks/aggregation/README.md). The limit is below that, and above the few per cent that are dropped
# by chance.
# Share of the views that disagree with their instance.
MAX_OUTLIERS = 0.25

# The middle of the range. It is 0.68 and 0.76 in synthetic apartments, and 0.55 and 0.48 in two series of
# photographs with the small checkpoints, which were not trained on photographs.
# Agreement of views with their instance, see ``agreement_of``.
MIN_AGREEMENT = 0.5

# Codes of 16 numbers reach 0.98. At 0.88 one object in three gets another name than from its full features,
# at 0.92 one in four (benchmarks/aggregation/README.md).
# Mean cosine between features and their decoded codes.
MIN_RECONSTRUCTION = 0.9

_MODEL = "set models.set to published, for a SAM2 trained on photographs"


def segments_alarms(
    empty_pixels: float | None,
    instances_per_frame: float | None,
    frames_per_instance: float | None,
) -> Iterator[Alarm]:
    """Alarms of the segments artifact.

    Args:
        empty_pixels: share of valid pixels without an instance at any level.
        instances_per_frame, frames_per_instance: means over frames and over instances.
    """
    if exceeds(empty_pixels, MAX_EMPTY_PIXELS):
        yield Alarm(
            "segments.empty_pixels",
            f"up to {MAX_EMPTY_PIXELS:.0%}",
            f"{empty_pixels:.1%} of the pixels belong to no instance",
            f"Queries find nothing there. Check instances.png, and {_MODEL}",
        )
    if falls_below(instances_per_frame, MIN_INSTANCES_PER_FRAME):
        yield Alarm(
            "segments.instances_per_frame",
            f"{MIN_INSTANCES_PER_FRAME:g} or more",
            f"frames have {instances_per_frame:.1f} instances on average",
            f"Check instances.png, and {_MODEL}",
        )
    if falls_below(frames_per_instance, MIN_FRAMES_PER_INSTANCE):
        yield Alarm(
            "segments.frames_per_instance",
            f"{MIN_FRAMES_PER_INSTANCE:g} or more",
            f"instances are tracked for {frames_per_instance:.1f} frames on average",
            "Tracks break, and there are too few views to aggregate. Reduce frames.stride, or use a longer recording",
        )


def instances_alarms(kept: int | None, masks: int | None, empty_pixels: float | None) -> Iterator[Alarm]:
    """Alarms of the instances artifact; None for all figures if nothing was merged.

    Args:
        kept, masks: number of masks that belong to an instance, and of all masks.
        empty_pixels: share of valid pixels without an instance at any level.
    """
    if kept is not None and masks and falls_below(kept / masks, MIN_MASKS_KEPT):
        yield Alarm(
            "instances.masks_kept",
            f"{MIN_MASKS_KEPT:.0%} or more",
            f"{kept} of {masks} masks belong to an instance",
            f"Masks of different frames do not agree in 3D. {_MERGING}",
        )
    if exceeds(empty_pixels, MAX_EMPTY_AFTER_MERGING):
        yield Alarm(
            "instances.empty_pixels",
            f"up to {MAX_EMPTY_AFTER_MERGING:.0%}",
            f"{empty_pixels:.1%} of the pixels belong to no instance",
            f"Queries find nothing there. {_MERGING}",
        )


def view_features_alarms(lost: int, views: int) -> Iterator[Alarm]:
    """Alarms of the view_features artifact.

    Args:
        lost: number of views without a finite feature.
        views: number of views with one.
    """
    if lost and exceeds(lost / (lost + views), MAX_LOST_VIEWS):
        yield Alarm(
            "view_features.lost",
            "none",
            f"{lost} of {lost + views} views have no finite feature",
            "Set run.precision to float32, or use another models.clip_checkpoint",
        )


def features_alarms(
    outliers: int, views: int, agreement: float | None, spread: float | None, reconstruction: float | None
) -> Iterator[Alarm]:
    """Alarms of the features artifact.

    Args:
        outliers: number of views that disagree with their instance.
        agreement: mean cosine between a view and its instance's consistent feature.
        spread: mean cosine between the consistent features of different instances.
        reconstruction: mean cosine between a feature and its decoded code.
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
            f"{MIN_AGREEMENT:g} or more, from 0 (like views of different instances) to 1 (equal)",
            f"views agree with their instance by {agreement_of(agreement, spread):.2f}: the mean cosine with it is "
            f"{agreement:.2f}, between instances {spread:.2f}",
            _TRACKS,
        )
    if falls_below(reconstruction, MIN_RECONSTRUCTION):
        yield Alarm(
            "features.reconstruction",
            f"{MIN_RECONSTRUCTION:g} or more",
            f"decoded codes have a mean cosine of {reconstruction:.2f} with their features",
            "Codes lose the differences between instances. Raise features.dims, or set it to auto",
        )


def agreement_of(agreement: float, spread: float) -> float:
    """Agreement relative to the spread: 0 if views are as unlike their instance as instances are to each other, 1 if equal."""
    return (agreement - spread) / (1.0 - spread) if spread < 1.0 else 1.0


_MERGING = "Check the poses, and instances.png; raise instances.iterations, or set segments.prompting to key_frames, which tracks in 2D"

_TRACKS = (
    "Tracks switch between objects, or OpenCLIP does not know them. Check crops.png, and use another "
    "models.sam2_checkpoint and models.clip_checkpoint"
)
