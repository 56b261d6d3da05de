"""Stage ``segments``: instances at three levels, followed through the video."""

from pathlib import Path

import numpy as np

from egosplat import provenance
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reading import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.writing import Writer, create
from egosplat.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2, model_hash
from egosplat.progress import log, track
from egosplat.segments.classical_video import segment_video
from egosplat.segments.instances import Segmented, settle
from egosplat.segments.options import LEVELS, MaskOptions, TrackOptions

CHECKPOINT_S = 60.0
"""Between two checkpoints [s]."""


def run(
    frames: Path,
    output: Path,
    *,
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
    batch: int,
    sam2_config: str,
    sam2_checkpoint: str,
    device: str,
    precision: str,
) -> None:
    """Write the segments artifact of ``frames``; the keys are those of the schema's ``segments`` and ``models``.

    A run with SAM2 that was killed goes on from its last checkpoint, to the same segments as without the kill.

    Raises:
        UserError: the model cannot be loaded, or nothing at all is found.
    """
    keys = {key: value for key, value in locals().items() if key not in ("frames", "output")}
    pictures = open_artifact(frames, FRAMES)
    used = {"sam2_config": sam2_config, "sam2_checkpoint": sam2_checkpoint}
    models = {"sam2_checkpoint": model_hash(SAM2, used)} if segmenter == "sam2" else {}
    inputs = {pictures.path.name: pictures.digest}
    made = provenance.begin("segments", keys, pictures.origin, inputs, models)
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
    checkpoint = Checkpoint(output, provenance.key_of(made), CHECKPOINT_S)
    if segmenter == "classical":
        count = pictures.shape("rgb")[0]
        segmented = segment_video(lambda frame: pictures.row("rgb", frame), count, pictures.read("valid"))
    else:
        model = (sam2_config, sam2_checkpoint, device, precision, image_size)
        segmented = _by_sam2(pictures, model, masks, tracks, checkpoint)
    try:
        with create(output, SEGMENTS, made) as artifact:
            _write(artifact, segmented, tracks.min_frames)
            artifact.facts |= {"segmenter": segmenter}
    except UserError:
        checkpoint.remove()  # going on would lead to the same end
        raise
    checkpoint.remove()


def _by_sam2(
    pictures: Artifact,
    model: tuple[str, str, str, str, int | None],
    masks: MaskOptions,
    tracks: TrackOptions,
    checkpoint: Checkpoint,
) -> Segmented:
    # Only here: the classical segmenter does without torch, which takes seconds to import.
    from egosplat.models.sam2_loader import load_sam2
    from egosplat.segments.tracking import Tracker

    sam2, count = load_sam2(*model), pictures.shape("rgb")[0]
    read = Tracker(
        sam2, lambda frame: pictures.row("rgb", frame), count, pictures.read("valid"), masks, tracks
    )
    return read.run(checkpoint)


def _write(artifact: Writer, segmented: Segmented, min_frames: int) -> None:
    """Merge what is one thing, drop what is seen too briefly, and write the rest frame by frame."""
    labels, count = segmented.labels, len(segmented.labels)
    settled = settle(segmented, min_frames)
    if len(settled.staying) == 0:
        raise UserError(
            "segments: nothing was found in any frame. Lower segments.pred_iou_thresh and stability_score_thresh, "
            "or take segmenter: classical"
        )
    first = labels[0]
    artifact.allocate("labels", (count, *first.shape))
    for frame in track(range(count), "writing labels"):
        artifact.put_row("labels", frame, settled.table[labels[frame]])
    chosen = [segmented.instances[number] for number in settled.staying]
    artifact.put("instances/level", np.array([one.level for one in chosen], dtype=np.int8))
    artifact.put("instances/predicted_iou", np.array([one.predicted_iou for one in chosen], dtype=np.float32))
    artifact.put("instances/stability", np.array([one.stability for one in chosen], dtype=np.float32))
    artifact.put("instances/first_frame", np.array([one.first_frame for one in chosen], dtype=np.int64))
    by_level = {name: sum(one.level == number for one in chosen) for number, name in enumerate(LEVELS)}
    dropped = len(segmented.instances) - len(settled.staying)
    log(f"{len(settled.staying)} instances ({by_level}); {dropped} merged with others or seen too briefly")
    artifact.facts = {
        "levels": list(LEVELS),
        "instances": by_level,
        "found": len(segmented.instances),
        "merged": settled.merged,
        **segmented.notes,
    }
