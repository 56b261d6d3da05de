"""Stage ``segments``: segment the frames at three levels and track the instances through the video."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, SEGMENTS, TRANSIENT, shown_pixels
from egosplat.artifacts.work import Work, lie_within
from egosplat.artifacts.writer import Writer, create
from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2, model_hash
from egosplat.progress import log, track
from egosplat.segments.classical.segmenter import segment_video
from egosplat.segments.instances import Segmented, finalize_instances
from egosplat.segments.options import LEVELS, SegmentsOptions


def run(
    frames_path: Path,
    output: Path,
    options: SegmentsOptions,
    *,
    survey_path: Path | None = None,
    transient_path: Path | None = None,
    chunk: int | None = None,
    gather: Sequence[Path] = (),
) -> None:
    """Write the segments artifact of ``frames``.

    A run with SAM2 that was killed resumes from its last checkpoint, with the same result.

    Args:
        survey_path: frames that the survey drops are skipped; all their labels are -1.
        transient_path: where things move, if the prompting is ``each_frame``; None to track nothing. A chunk needs none.
        chunk, gather: as in ``Work``, if the prompting is ``each_frame``.

    Raises:
        UserError: the model cannot be loaded, the survey or transient.zarr is missing or of other frames, no instance
            is found, or there are chunks of a video that is tracked.
    """
    if not options.single_frames and (chunk or gather):
        raise UserError(
            "segments: only frames that SAM2 segments one by one make chunks; set segments.prompting to each_frame"
        )
    frames = open_artifact(frames_path, FRAMES)
    kept, by_survey = kept_frames(frames, survey_path)
    used = {"sam2_config": options.sam2_config, "sam2_checkpoint": options.sam2_checkpoint}
    models = {"sam2_checkpoint": model_hash(SAM2, used)} if options.segmenter == "sam2" else {}
    transient = None if chunk else _open_transient(transient_path, frames, options)
    video = _Video(frames, np.flatnonzero(kept), transient)
    about = "segments", options.as_dict() | by_survey
    made = provenance.begin_from(*about, [frames, *([transient] if transient else [])], models)
    # Masks of single frames do not depend on what moves.
    alone = provenance.begin_from(*about, [frames], models)
    work = Work(output, alone, len(kept), chunk, gather)
    if options.segmenter == "classical":
        segmented = segment_video(video.image, len(video.frame), video.valid, video.shown)
    else:
        found = _segment_with_sam2(
            video, options, work, Checkpoint(output, provenance.key_of(made), part="tracks")
        )
        if found is None:
            return
        segmented = found
    try:
        with create(output, SEGMENTS, replace(made, gathered=work.costs)) as artifact:
            _write(artifact, segmented, video, options)
            artifact.facts |= {"segmenter": options.segmenter, "single_frames": options.single_frames}
    except UserError:
        work.finish()  # resuming would give the same error
        raise
    work.finish()


@dataclass(frozen=True)
class _Video:
    """The frames to segment.

    Attributes:
        frame: (N,) index of each in frames.zarr.
        transient: where things move.
    """

    source: Artifact
    frame: NDArray[np.intp]
    transient: Artifact | None

    def image(self, place: int) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB image of the frame at a place in the video."""
        return self.source.row("rgb", self.frame[place])

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W) bool: pixels inside the lens circle."""
        return self.source.read("valid")

    def shown(self, place: int) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of the frame at a place that show the scene."""
        return shown_pixels(self.source, int(self.frame[place]), self.valid)

    def probability(self, place: int) -> NDArray[np.float16]:
        """(H, W) float16 probability in 0..1 that a pixel moves."""
        assert self.transient is not None
        return self.transient.row("probability", self.frame[place])

    def trained(self) -> NDArray[np.intp]:
        """Places of the training frames."""
        return np.flatnonzero(self.source.read("train")[self.frame])


def _open_transient(path: Path | None, frames: Artifact, options: SegmentsOptions) -> Artifact | None:
    """Open the transient artifact if what moves is tracked."""
    if not options.single_frames or options.track_moving == "never":
        return None
    if path is None:
        if options.track_moving == "always":
            raise UserError("segments.track_moving = always needs the transient artifact: give --transient")
        return None
    transient = open_artifact(path, TRANSIENT)
    check_made_from(transient, frames, axes=("frame", "height", "width"))
    return transient


def _segment_with_sam2(
    video: _Video, options: SegmentsOptions, work: Work, checkpoint: Checkpoint
) -> Segmented | None:
    """Segment the frames, or those of a chunk, and track; None for a chunk. ``checkpoint`` is that of tracking."""
    # Imported here: sam2 takes seconds to import, and the classical segmenter does not need it.
    from egosplat.models.sam2_loader import load_sam2
    from egosplat.segments.moving import MovingTracker, add_tracks
    from egosplat.segments.prompts import prompted_frames
    from egosplat.segments.single_frames import SingleFrames, join_frames
    from egosplat.segments.tracker import Tracker

    model = (options.sam2_config, options.sam2_checkpoint, options.device, options.precision)
    side = None if options.single_frames else options.image_size
    sam2, valid, shown = load_sam2(*model, side), video.valid, video.shown
    if not options.single_frames:
        return Tracker(sam2, video.image, len(video.frame), valid, options, shown).run(checkpoint)
    single = SingleFrames(sam2, video.image, valid, options, shown)
    frames = np.array(prompted_frames(video.trained(), options), np.intp)
    found = work.results(
        lambda chunks: frames[lie_within(video.frame[frames], chunks)].tolist(),
        lambda few: map(single.segment, few),
        "segmenting frames",
    )
    if found is None:
        return None
    segmented = join_frames(found, frames.tolist(), len(video.frame), valid.shape)
    if not video.transient:
        return segmented
    about = (video.trained(), len(video.frame), valid, options, shown)
    movers = MovingTracker(sam2, video.image, video.probability, *about)
    return add_tracks(segmented, movers.moving_tracks(checkpoint))


def _write(artifact: Writer, segmented: Segmented, video: _Video, options: SegmentsOptions) -> None:
    """Merge duplicates, drop short tracks, and write the remaining instances."""
    labels, count = segmented.labels, video.source.shape("rgb")[0]
    place_of = {int(frame): place for place, frame in enumerate(video.frame)}
    single = options.single_frames
    final = finalize_instances(segmented, 1 if single else options.min_frames)
    if len(final.kept) == 0:
        raise UserError(
            "segments: no instance was found in any frame. Raise segments.points_per_side or lower segments.min_area, "
            "or set segments.segmenter to classical"
        )
    first = labels[0]
    artifact.allocate("labels", (count, *first.shape))
    occupancy = Occupancy(len(final.kept))
    counted = segmented.notes["key_frames"] if single else range(len(video.frame))
    for frame in track(range(count), "writing labels"):
        place = place_of.get(frame)
        row = np.full_like(first, -1) if place is None else final.table[labels[place]]
        if place in counted:
            occupancy.add(row, video.shown(place_of[frame]))
        artifact.put_row("labels", frame, row)
    chosen = [segmented.instances[number] for number in final.kept]
    types = {"level": np.int8, "predicted_iou": np.float32, "stability": np.float32, "moving": bool}
    columns = {name: np.array([getattr(one, name) for one in chosen], kind) for name, kind in types.items()}
    columns["first_frame"] = video.frame[[one.first_frame for one in chosen]].astype(np.int64)
    for name, values in columns.items():
        artifact.put(f"instances/{name}", values)
    moving = int(columns["moving"].sum())
    by_level = {name: sum(one.level == number for one in chosen) for number, name in enumerate(LEVELS)}
    dropped = len(segmented.instances) - len(final.kept)
    named = ", ".join(f"{number} {name}s" for name, number in by_level.items())
    log(f"{len(chosen)} instances ({named}); {dropped} more are merged into them or seen in too few frames")
    if single:
        log(f"{moving} of them are tracked, because they move; each other is a mask of one frame")
    artifact.facts = {
        "levels": list(LEVELS),
        "instances": by_level,
        "found": len(segmented.instances),
        "moving": moving,
        "merged": final.merged,
        **occupancy.figures(tracked=not single),
        **{name: video.frame[places].tolist() for name, places in segmented.notes.items()},
    }


class Occupancy:
    """Coverage statistics of N instances over the segmented frames."""

    def __init__(self, instances: int) -> None:
        """Start with no frame; ``instances``: N."""
        self._frames_of = np.zeros(instances, np.int64)
        self._frames = 0
        self._pixels = self._empty_pixels = 0

    def add(self, labels: NDArray[np.int32], shown: NDArray[np.bool_]) -> None:
        """Count a frame: (L, H, W) instance at each level, -1 for none, and (H, W) bool pixels that show the scene."""
        found = np.unique(labels)
        self._frames_of[found[found >= 0]] += 1
        self._frames += 1
        self._empty_pixels += int(((labels < 0).all(axis=0) & shown).sum())
        self._pixels += int(shown.sum())

    def figures(self, *, tracked: bool = True) -> dict[str, float]:
        """Share of the pixels that show the scene without an instance at any level, mean instances per frame, mean frames per instance.

        Without ``tracked``, an instance is a mask of one frame, and the last figure is left out.
        """
        views = int(self._frames_of.sum())
        lengths = {"frames_per_instance": views / max(len(self._frames_of), 1)} if tracked else {}
        return {
            "pixels_without_instance": self._empty_pixels / max(self._pixels, 1),
            "instances_per_frame": views / max(self._frames, 1),
            **lengths,
        }
