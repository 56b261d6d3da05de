"""Stage ``instances``: merge the masks of segments.zarr into things that hold in 3D."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from, kept_frames
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, POSES, SEGMENTS, SPLATS, TRACKS, shown_pixels
from egosplat.artifacts.writer import create
from egosplat.gaussians.corrections import resolve_camera
from egosplat.gaussians.training_views import split_views
from egosplat.instances.geometry import given_geometry, train_geometry
from egosplat.instances.lifted_masks import lift
from egosplat.instances.moving import MovingTracks, standing_tracks
from egosplat.instances.options import InstancesOptions
from egosplat.instances.scene import Scene, find_scene
from egosplat.progress import log, track


def run(
    frames_path: Path,
    poses_path: Path,
    segments_path: Path,
    output: Path,
    options: InstancesOptions,
    *,
    survey_path: Path | None = None,
    splats_path: Path | None = None,
) -> None:
    """Write the instances artifact. A killed run resumes the training of temporary Gaussians, with the same result.

    UserError: the inputs do not belong together, no training frame has a pose, or no mask is left.

    Args:
        survey_path: path of the survey, which excludes frames and decides keys that are ``auto``.
        splats_path: path of the scene's Gaussians; None: temporary ones are trained.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    segments = open_artifact(segments_path, SEGMENTS)
    check_made_from(poses, frames, axes=("frame",))
    check_made_from(segments, frames, axes=("frame", "height", "width"))
    options = resolve_camera(options, survey_path)
    kept, by_survey = kept_frames(frames, survey_path)
    splats = None if splats_path is None else open_artifact(splats_path, SPLATS)
    # Not an input that all must share: variants that train other Gaussians keep the instances.
    merged_on = {}
    if splats is not None:
        check_made_from(splats, frames, poses)
        merged_on = {"splats": splats.digest}
    keys = options.as_dict() | by_survey | merged_on
    record = provenance.begin_from("instances", keys, (frames, poses, segments))
    if options.source == "auto":
        # Masks of single frames are no tracks.
        options = options.change(source="masks" if segments.facts.get("single_frames") else TRACKS)
    if options.source == TRACKS:
        _write_tracks(output, record, segments)
        return
    training, _ = split_views(frames, poses, kept)
    key = provenance.key_of(record)
    if splats is not None:
        geometry = given_geometry(frames, poses, splats, training, options)
    else:
        geometry = train_geometry(frames, poses, training, options, output, key)
    shown = partial(shown_pixels, frames, valid=frames.read("valid"))
    tracks = MovingTracks(segments)
    lifted = lift(geometry, segments, shown, tracks.keep)
    if lifted is not None:
        times_s = frames.read("timestamp_ns")[lifted.row] / 1e9
        tracks = MovingTracks(segments, standing_tracks(lifted, times_s))
    del lifted  # as large as the masks of things
    scene = find_scene(geometry, segments, shown, tracks)
    rows = np.flatnonzero(kept & poses.read("registered"))
    _write_things(output, record, scene, tracks, segments, rows)
    Checkpoint(output, key, 0.0).remove()


def _write_tracks(output: Path, record: Provenance, segments: Artifact) -> None:
    level = segments.read("instances/level")
    shape = segments.shape("labels")
    with create(output, INSTANCES, record) as artifact:
        artifact.allocate("labels", shape)
        for frame in track(range(shape[0]), "copying labels"):
            artifact.put_row("labels", frame, segments.row("labels", frame))
        artifact.put("instances/level", level)
        artifact.put("instances/masks", np.ones(len(level), np.int32))
        artifact.put("instances/moving", segments.read("instances/moving"))
        artifact.put("gaussians/xyz", np.zeros((0, 3), np.float32))
        artifact.put("gaussians/instance", np.zeros((0, shape[1]), np.int32))
        artifact.facts = _facts(segments, level, TRACKS)


def _write_things(
    output: Path,
    record: Provenance,
    scene: Scene,
    tracks: MovingTracks,
    segments: Artifact,
    rows: NDArray[np.intp],
) -> None:
    """Label the frames ``rows`` with the things, draw what moves over them in all frames, and write both."""
    shape, count = segments.shape("labels"), len(scene.level)
    nothing = np.full(shape[1:], -1, np.int32)
    posed, empty, pixels = set(rows.tolist()), 0, 0
    with create(output, INSTANCES, record) as artifact:
        artifact.allocate("labels", shape)
        for frame in track(range(shape[0]), "writing labels"):
            found = segments.row("labels", frame)
            things = scene.label(frame, found) if frame in posed else nothing
            labels = tracks.draw(found, things, count)
            artifact.put_row("labels", frame, labels)
            if frame in posed:
                seen = scene.shown(frame)
                empty += int((labels[:, seen] < 0).all(axis=0).sum())
                pixels += int(seen.sum())
        moving = np.arange(count + len(tracks.level)) >= count
        level = np.concatenate([scene.level, tracks.level])
        artifact.put("instances/level", level)
        artifact.put("instances/masks", np.concatenate([scene.masks, tracks.frames]))
        artifact.put("instances/moving", moving)
        artifact.put("gaussians/xyz", scene.geometry.gaussians.means.cpu().numpy())
        artifact.put("gaussians/instance", scene.strongest())
        artifact.facts = _facts(segments, level, "masks") | {
            "merging": scene.counts,
            "pixels_without_instance": empty / max(pixels, 1),
            "standing_tracks": len(tracks.standing),
        }


def _facts(segments: Artifact, level: NDArray[np.int8], source: str) -> dict[str, Any]:
    """Facts that consumers read: names of the levels, and how many instances each has."""
    names = segments.facts["levels"]
    by_level = {name: int((level == number).sum()) for number, name in enumerate(names)}
    log(f"{len(level)} instances ({', '.join(f'{count} {name}s' for name, count in by_level.items())})")
    return {"levels": names, "instances": by_level, "source": source}
