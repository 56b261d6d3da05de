"""Stage ``segments``: instances at three levels, followed through the video."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.writer import Writer, create
from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2, model_hash
from egosplat.progress import log, track
from egosplat.segments.classical.video import segment_video
from egosplat.segments.duplicate_levels import repeated_levels, without
from egosplat.segments.instances import Segmented, Settled, settle
from egosplat.segments.occupancy import Occupancy
from egosplat.segments.options import LEVELS, MaskOptions, TrackOptions

CHECKPOINT_S = 60.0
"""Between two checkpoints [s]."""


def run(
    frames: Path,
    output: Path,
    *,
    survey: Path | None = None,
    segmenter: str,
    image_size: int | None,
    points_per_side: int,
    pred_iou_thresh: float,
    stability_score_thresh: float,
    stability_score_offset: float,
    box_nms_thresh: float,
    nms_iou_thresh: float,
    nms_score_thresh: float,
    nms_inner_thresh: float,
    min_area: float,
    prompting: str,
    key_frame_stride: int,
    min_uncovered: float,
    new_cover_thresh: float,
    merge_iou: float,
    min_frames: int,
    max_instances: int,
    share_iou: float,
    absent_stride: int,
    levels: str,
    batch: int,
    sam2_config: str,
    sam2_checkpoint: str,
    device: str,
    precision: str,
) -> None:
    """Write the segments artifact of ``frames``; the keys are those of the schema's ``segments`` and ``models``.

    A run with SAM2 that was killed goes on from its last checkpoint, to the same segments as without the kill.

    Args:
        frames, output: paths.
        survey: the frames that it leaves out are passed over, as if they had not been filmed: their labels are all -1.

    Raises:
        UserError: the model cannot be loaded, the survey is of other frames, or nothing at all is found.
    """
    keys = {key: value for key, value in locals().items() if key not in ("frames", "output", "survey")}
    pictures = open_artifact(frames, FRAMES)
    kept, by_survey = kept_frames(pictures, survey)
    used = {"sam2_config": sam2_config, "sam2_checkpoint": sam2_checkpoint}
    models = {"sam2_checkpoint": model_hash(SAM2, used)} if segmenter == "sam2" else {}
    made = provenance.begin_from("segments", keys | by_survey, [pictures], models)
    masks = MaskOptions(
        points_per_side,
        pred_iou_thresh,
        stability_score_thresh,
        stability_score_offset,
        box_nms_thresh,
        nms_iou_thresh,
        nms_score_thresh,
        nms_inner_thresh,
        min_area,
    )
    tracks = TrackOptions(
        prompting == "key_frames",
        key_frame_stride,
        min_uncovered,
        new_cover_thresh,
        merge_iou,
        min_frames,
        max_instances,
        share_iou,
        absent_stride,
        batch,
    )
    video = _Video(pictures, np.flatnonzero(kept))
    checkpoint = Checkpoint(output, provenance.key_of(made), CHECKPOINT_S)
    if segmenter == "classical":
        segmented = segment_video(video.picture, len(video.frame), pictures.read("valid"))
    else:
        model = (sam2_config, sam2_checkpoint, device, precision, image_size)
        segmented = _by_sam2(video, model, masks, tracks, checkpoint)
    try:
        with create(output, SEGMENTS, made) as artifact:
            _write(artifact, segmented, video, tracks.min_frames, levels)
            artifact.facts |= {"segmenter": segmenter}
    except UserError:
        checkpoint.remove()  # going on would lead to the same end
        raise
    checkpoint.remove()


@dataclass(frozen=True)
class _Video:
    """The frames that are worked through; ``frame``: index of each in frames.zarr."""

    source: Artifact
    frame: NDArray[np.intp]

    def picture(self, place: int) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB of the frame at a place of the video."""
        return self.source.row("rgb", self.frame[place])


def _by_sam2(
    video: _Video,
    model: tuple[str, str, str, str, int | None],
    masks: MaskOptions,
    tracks: TrackOptions,
    checkpoint: Checkpoint,
) -> Segmented:
    # Only here: the classical segmenter does without torch, which takes seconds to import.
    from egosplat.models.sam2_loader import load_sam2
    from egosplat.segments.tracker import Tracker

    sam2, valid = load_sam2(*model), video.source.read("valid")
    return Tracker(sam2, video.picture, len(video.frame), valid, masks, tracks).run(checkpoint)


def _write(artifact: Writer, segmented: Segmented, video: _Video, min_frames: int, levels: str) -> None:
    """Merge what is one thing, drop what is seen too briefly and levels that repeat, and write the rest by frame."""
    labels, count = segmented.labels, video.source.shape("rgb")[0]
    place_of = {int(frame): place for place, frame in enumerate(video.frame)}
    settled = settle(segmented, min_frames)
    if len(settled.staying) == 0:
        raise UserError(
            "segments: nothing was found in any frame. Lower segments.pred_iou_thresh and stability_score_thresh, "
            "or take segmenter: classical"
        )
    settled, repeated = _own_levels(segmented, settled) if levels == "auto" else (settled, {})
    first = labels[0]
    artifact.allocate("labels", (count, *first.shape))
    occupancy = Occupancy(len(settled.staying), video.source.read("valid"))
    for frame in track(range(count), "writing labels"):
        place = place_of.get(frame)
        row = np.full_like(first, -1) if place is None else settled.table[labels[place]]
        if place is not None:
            occupancy.add(row)
        artifact.put_row("labels", frame, row)
    chosen = [segmented.instances[number] for number in settled.staying]
    artifact.put("instances/level", np.array([one.level for one in chosen], dtype=np.int8))
    artifact.put("instances/predicted_iou", np.array([one.predicted_iou for one in chosen], dtype=np.float32))
    artifact.put("instances/stability", np.array([one.stability for one in chosen], dtype=np.float32))
    begun = video.frame[[one.first_frame for one in chosen]]
    artifact.put("instances/first_frame", begun.astype(np.int64))
    by_level = {name: sum(one.level == number for one in chosen) for number, name in enumerate(LEVELS)}
    dropped = len(segmented.instances) - len(settled.staying)
    log(
        f"{len(settled.staying)} instances ({by_level}); {dropped} merged with others, repeated or seen too briefly"
    )
    artifact.facts = {
        "levels": list(LEVELS),
        "instances": by_level,
        "found": len(segmented.instances),
        "merged": settled.merged,
        "repeats": {LEVELS[one]: LEVELS[other] for one, other in repeated.items()},
        **occupancy.figures(),
        **_renamed(segmented.notes, video),
    }


def _own_levels(segmented: Segmented, settled: Settled) -> tuple[Settled, dict[int, int]]:
    """What stays without the levels that repeat another, and these."""
    level = np.array([segmented.instances[number].level for number in settled.staying], dtype=np.int8)
    repeated = repeated_levels(segmented.labels, settled.table, level, len(LEVELS))
    for one, other in repeated.items():
        log(f"level {LEVELS[one]} is left out: it repeats {LEVELS[other]}")
    table = without(repeated, settled.table, level)
    return replace(settled, table=table, staying=settled.staying[~np.isin(level, list(repeated))]), repeated


def _renamed(notes: dict[str, Any], video: _Video) -> dict[str, Any]:
    """The notes with frames in place of places in the video."""
    if "key_frames" not in notes:
        return notes
    return notes | {"key_frames": [int(video.frame[place]) for place in notes["key_frames"]]}
