"""Stage ``segments``: segment the frames at three levels and track the instances through the video."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Ints, Ints32
from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint, Work, lie_within
from egosplat.artifacts.consistency import check_made_from, kept_frames
from egosplat.artifacts.reader import Artifact, open_artifact, open_needed
from egosplat.artifacts.schemas import FRAMES, POSES, SEGMENTS, TRANSIENT, shown_pixels
from egosplat.artifacts.writer import Writer, create
from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2, model_hash
from egosplat.progress import log, track
from egosplat.segments.classical import segment_video
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.video import Segmented, Video, finalize_instances


def run(
    frames_path: Path,
    output: Path,
    options: SegmentsOptions,
    *,
    poses_path: Path | None = None,
    survey_path: Path | None = None,
    transient_path: Path | None = None,
    chunk: int | None = None,
    gather: Sequence[Path] = (),
) -> None:
    """Write the segments artifact of ``frames``. A killed run with SAM2 resumes, with the same result.
    UserError: the model cannot be loaded, the survey or transient.zarr is missing or of other frames, no
    instance is found, or there are chunks of a video that is tracked. ``poses_path``: only frames with a pose
    are prompted, if the prompting is ``each_frame``; None prompts any. ``survey_path``: frames that the survey
    drops are skipped; all their labels are -1. ``transient_path``: where things move, if the prompting is
    ``each_frame``; None to track nothing. A chunk needs none. ``chunk``, ``gather``: as in ``Work``, if the
    prompting is ``each_frame``."""
    if not options.single_frames and (chunk or gather):
        raise UserError(
            "segments: only frames that SAM2 segments one by one make chunks; set segments.prompting to each_frame"
        )
    frames = open_artifact(frames_path, FRAMES)
    kept, by_survey = kept_frames(frames, survey_path)
    models = {"sam2_checkpoint": model_hash(SAM2, options.as_dict())} if options.segmenter == "sam2" else {}
    transient = None if chunk else _open_transient(transient_path, frames, options)
    made_from, useful = [frames], frames.read("train")
    if poses_path and options.single_frames:
        made_from.append(open_artifact(poses_path, POSES))
        check_made_from(made_from[1], frames, axes=("frame",))
        useful &= made_from[1].read("registered")
    rows, valid = np.flatnonzero(kept), frames.read("valid")
    video = Video(
        len(rows),
        lambda place: frames.row("rgb", int(rows[place])),
        lambda place: shown_pixels(frames, int(rows[place]), valid),
    )
    about = "segments", options.as_dict() | by_survey
    made = provenance.begin_from(*about, [*made_from, *([transient] if transient else [])], models)
    # Masks of single frames do not depend on what moves.
    work = Work(output, provenance.begin_from(*about, made_from, models), len(kept), chunk, gather)
    if options.segmenter == "classical":
        segmented = segment_video(video)
    else:
        tracks = Checkpoint(output, provenance.key_of(made), part="tracks")
        training = np.flatnonzero(useful[rows])
        segmented = _segment_with_sam2(video, rows, training, transient, options, work, tracks)
    if segmented is None:
        return
    table, instances, merged = finalize_instances(
        segmented, 1 if options.single_frames else options.min_frames
    )
    if len(instances) == 0:
        work.finish()  # resuming would give the same
        raise UserError(
            "segments: no instance was found in any frame. Raise segments.points_per_side or lower segments.min_area, "
            "or set segments.segmenter to classical"
        )
    with create(output, SEGMENTS, replace(made, gathered=work.costs)) as artifact:
        single = options.single_frames
        facts = {"segmenter": options.segmenter, "single_frames": single, "merged": merged}
        facts |= _put_instances(artifact, segmented, instances, rows)
        artifact.facts = facts | _put_labels(artifact, segmented, table, video, rows, len(kept), single)
    work.finish()


def _open_transient(path: Path | None, frames: Artifact, options: SegmentsOptions) -> Artifact | None:
    """Open the transient artifact if what moves is tracked."""
    if not options.single_frames or options.track_moving == "never":
        return None
    if path is None and options.track_moving != "always":
        return None
    [transient] = open_needed("segments.track_moving = always", (path, TRANSIENT))
    check_made_from(transient, frames, axes=("frame", "height", "width"))
    return transient


def _segment_with_sam2(
    video: Video,
    rows: NDArray[np.intp],
    training: NDArray[np.intp],
    transient: Artifact | None,
    options: SegmentsOptions,
    work: Work,
    tracks: Checkpoint,
) -> Segmented | None:
    """Segment frames ``rows``, of which ``training`` may be prompted, and track (checkpoint ``tracks``); None for a chunk."""
    # Imported here: sam2 takes seconds to import, and the classical segmenter does not need it.
    from egosplat.models.sam2_loader import load_sam2
    from egosplat.segments.moving import add_tracks, track_moving
    from egosplat.segments.single_frames import join_frames, segment_frame
    from egosplat.segments.tracker import Tracker

    model = (options.sam2_config, options.sam2_checkpoint, options.device, options.precision)
    sam2 = load_sam2(*model, None if options.single_frames else options.image_size)
    if not options.single_frames:
        return Tracker(sam2, video, options).run(tracks)
    frames = options.key_frames(training)
    found = work.results(
        lambda chunks: frames[lie_within(rows[frames], chunks)].tolist(),
        lambda few: (segment_frame(sam2, video, frame, options) for frame in few),
        "segmenting frames",
    )
    if found is None:
        return None
    segmented = join_frames(found, frames.tolist(), video.length, video.shown(0).shape)
    if transient is None:
        return segmented
    probability = lambda place: transient.row("probability", int(rows[place]))
    with sam2.at_side(options.track_side):
        return add_tracks(segmented, track_moving(sam2, video, options, probability, training, tracks))


def _put_labels(
    artifact: Writer,
    segmented: Segmented,
    table: Ints32,
    video: Video,
    rows: NDArray[np.intp],
    count: int,
    single: bool,
) -> dict[str, Any]:
    """Write the labels of all ``count`` frames, -1 where the video leaves one out; returns facts of their coverage."""
    nothing = np.full_like(segmented.labels[0], -1)
    artifact.allocate("labels", (count, *nothing.shape))
    places = dict(zip(rows.tolist(), range(video.length), strict=True))
    counted = set(segmented.prompted if single else range(video.length))
    views = empty = pixels = 0
    for frame in track(range(count), "writing labels"):
        place = places.get(frame)
        row = nothing if place is None else table[segmented.labels[place]]
        artifact.put_row("labels", frame, row)
        if place in counted:
            shown = video.shown(place)
            views += int((np.unique(row) >= 0).sum())
            empty += int(((row < 0).all(axis=0) & shown).sum())
            pixels += int(shown.sum())
    facts: dict[str, Any] = {
        "pixels_without_instance": empty / max(pixels, 1),
        "instances_per_frame": views / max(len(counted), 1),
    }
    if not single:  # without tracks, an instance is a mask of one frame
        facts["frames_per_instance"] = views / (int(table.max()) + 1)
    if segmented.prompted:  # the classical segmenter prompts nothing
        facts["key_frames"] = rows[segmented.prompted].tolist()
    return facts


def _put_instances(
    artifact: Writer, segmented: Segmented, kept: Ints, rows: NDArray[np.intp]
) -> dict[str, Any]:
    """Write the instances that are kept; returns facts of their number."""
    chosen = [segmented.instances[number] for number in kept]
    types = {"level": np.int8, "predicted_iou": np.float32, "stability": np.float32, "moving": bool}
    columns = {name: np.array([getattr(one, name) for one in chosen], kind) for name, kind in types.items()}
    columns["first_frame"] = rows[[one.first_frame for one in chosen]].astype(np.int64)
    for name, values in columns.items():
        artifact.put(f"instances/{name}", values)
    moving, count = int(columns["moving"].sum()), len(segmented.instances)
    by_level = {name: int((columns["level"] == level).sum()) for level, name in enumerate(LEVELS)}
    named = ", ".join(f"{number} {name}s" for name, number in by_level.items())
    log(
        f"{len(kept)} instances ({named}), {moving} of them moving; {count - len(kept)} more are merged or seen too briefly"
    )
    return {"levels": list(LEVELS), "instances": by_level, "found": count, "moving": moving}
