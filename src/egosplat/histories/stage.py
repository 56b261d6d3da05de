"""Stage ``histories``: what is carried from where to where, Gaussians of what lies somewhere for a while, and which of both are of one
thing (docs/method.md#carries)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import (
    FRAMES,
    HISTORIES,
    INSTANCES,
    MASKS,
    POSES,
    SPLATS,
    VIEW_FEATURES,
    camera_poses,
    is_track,
    lies_on_its_side,
    seconds_of,
)
from egosplat.artifacts.writer import create
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_exposure, read_gaussians, read_render_settings
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.geometry import Camera, known_poses
from egosplat.histories.moves import Carry, find_carries
from egosplat.histories.options import HistoriesOptions
from egosplat.histories.places import Recording, Scenery, scene_depth, see_places
from egosplat.histories.rests import Rest, ends_of, find_rests, link
from egosplat.histories.sightings import see_tracks
from egosplat.histories.things import Look, find_things, look_at
from egosplat.language.vectors import unit
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_clip_of
from egosplat.progress import log

# Carries whose features have this cosine show one thing.
_ALIKE = 0.9

# Arrays by name.
Columns = dict[str, NDArray]


def run(
    frames_path: Path,
    poses_path: Path,
    instances_path: Path,
    view_features_path: Path,
    splats_path: Path,
    output: Path,
    options: HistoriesOptions,
    *,
    masks_path: Path | None = None,
) -> None:
    """Write the carries and rests of a recording; none where nothing is tracked.

    Args:
        masks_path: required if the Gaussians were trained with refined masks.

    Raises:
        UserError: the inputs do not belong together, the model did not make the features, or the backend cannot run.
    """
    paths = (frames_path, poses_path, instances_path, view_features_path, splats_path)
    kinds = (FRAMES, POSES, INSTANCES, VIEW_FEATURES, SPLATS)
    frames, poses, instances, views, splats = inputs = [*map(open_artifact, paths, kinds)]
    masks = () if masks_path is None else (open_artifact(masks_path, MASKS),)
    check_made_from(poses, frames, axes=("frame",))
    check_made_from(instances, frames, axes=("frame", "height", "width"))
    check_made_from(views, frames, instances)
    check_made_from(splats, frames, poses, *masks)
    model = {CLIP.config_key: options.clip_model, CLIP.checkpoint_key: options.clip_checkpoint}
    hashes = {CLIP.checkpoint_key: model_hash(CLIP, model)}
    record = provenance.begin_from("histories", options.as_dict(), [*inputs, *masks], hashes)
    scene = _read_scenery(splats, options)
    recording = _read_recording(frames, poses, instances, splats, masks, scene)
    seen = see_tracks(known_poses(recording.camera_to_world), is_track(instances), recording)
    found, tracks = find_carries(seen, seconds_of(frames)), len(np.unique(seen.track))
    log(f"{len(found)} carries in {tracks} tracks of what moves")
    carries = _carries(found, views)
    rests, links = _find_rests(carries, frames, recording, scene)
    looks = _look_at(rests, scene, views, options, lies_on_its_side(frames))
    things, of_carries, features = find_things(rests, looks, links, carries["feature"])
    log(f"{len(rests)} rests of {len(features)} things")
    groups = {
        "carries": carries | {"thing": of_carries, "from_rest": links[0], "to_rest": links[1]},
        "rests": _rests(rests, things, looks),
        "things": {"feature": features},
        "gaussians": _gaussians(rests, scene),
    }
    with create(output, HISTORIES, record) as artifact:
        for group, columns in groups.items():
            for name, values in columns.items():
                artifact.put(f"{group}/{name}", values)
        artifact.facts = {"tracks": tracks}


def _find_rests(
    carries: Columns, frames: Artifact, recording: Recording, scene: Scenery
) -> tuple[list[Rest], NDArray[np.int32]]:
    """The rests at the ends of carries, and ``link`` between both."""
    seconds, known = seconds_of(frames), known_poses(recording.camera_to_world)
    ends = ends_of(carries, seconds)
    places, training = [end.place for end in ends], known[frames.read("train")[known]]
    views = see_places(places, training, recording, scene)
    rests = find_rests(ends, views, seconds, scene)
    return rests, link(ends, rests, seconds, len(carries["instance"]))


def _look_at(
    rests: Sequence[Rest], scene: Scenery, views: Artifact, options: HistoriesOptions, turned: bool
) -> list[Look]:
    """How each rest looks to the OpenCLIP that made the features of views; it is loaded if something rests."""
    if not rests:
        return []
    files = options.clip_model, options.clip_checkpoint
    clip = load_clip_of(views, *files, options.device, options.precision)
    return [look_at(one, scene, clip, turned) for one in rests]


def _read_scenery(splats: Artifact, options: HistoriesOptions) -> Scenery:
    gaussians = read_gaussians(splats).to(training_device(options.backend))
    settings, (_, compression) = read_render_settings(splats, options.backend), read_exposure(splats)
    return Scenery(gaussians, settings, splats.facts["sh_degree_in_use"], options.seed, compression)


def _read_recording(
    frames: Artifact,
    poses: Artifact,
    instances: Artifact,
    splats: Artifact,
    masks: Sequence[Artifact],
    scene: Scenery,
) -> Recording:
    camera, camera_to_world = Camera(**splats.facts["camera"]), camera_poses(poses, splats)
    log_gains, _ = read_exposure(splats)
    return Recording(
        lambda frame: frames.row("rgb", frame),
        lambda frame: instances.row("labels", frame),
        _moving(instances, masks),
        scene_depth(scene, camera, camera_to_world),
        lambda frame: None if log_gains is None else log_gains[frame],
        frames.read("valid"),
        camera,
        camera_to_world,
    )


def _moving(
    instances: Artifact, masks: Sequence[Artifact]
) -> Callable[[int, NDArray[np.int32]], NDArray[np.bool_]]:
    """Tell the pixels of what moves in a frame with these labels: tracks, and refined masks if there are any."""
    # Label -1 indexes the last entry.
    tracks = np.append(is_track(instances), False)

    def moving(frame: int, labels: NDArray[np.int32]) -> NDArray[np.bool_]:
        refined = [one.row("refined", frame) for one in masks]
        return np.logical_or.reduce([tracks[labels].any(axis=0), *refined])

    return moving


def _carries(found: Sequence[Carry], views: Artifact) -> Columns:
    best = [int(np.argmax(one.seen.area)) for one in found]
    pairs = list(zip(found, best, strict=True))
    return {
        "instance": np.array([one.track for one in found], np.int32),
        "first_frame": np.array([one.first for one in found], np.int64),
        "last_frame": np.array([one.last for one in found], np.int64),
        "start": np.array([one.start for one in found], np.float64).reshape(-1, 3),
        "end": np.array([one.end for one in found], np.float64).reshape(-1, 3),
        "size": np.array([one.size for one in found], np.float64),
        "best_frame": np.array([one.seen.frame[place] for one, place in pairs], np.int64),
        "box": np.array([one.seen.box[place] for one, place in pairs], np.int32).reshape(-1, 4),
        "feature": _features_of_carries(found, views),
    }


def _features_of_carries(found: Sequence[Carry], views: Artifact) -> NDArray[np.float32]:
    """(C, D) mean feature of the views of each carry and of those that look alike, of unit norm; zeros without views."""
    instance, frame, feature = (views.read(name) for name in ("instance", "frame", "feature"))
    features = np.zeros((len(found), feature.shape[1]), np.float32)
    for number, one in enumerate(found):
        shown = np.isin(instance, [one.track, *one.others]) & np.isin(frame, one.seen.frame)
        features[number] = unit(feature[shown].sum(axis=0, dtype=np.float64))
    # Views of one carry alone often miss its name: a few masks show parts of it.
    alike = features @ features.T >= _ALIKE
    return unit(alike @ features).astype(np.float32)


def _rests(rests: Sequence[Rest], things: NDArray[np.int32], looks: Sequence[Look]) -> Columns:
    frames, absent = (
        np.array([getattr(one, name) for one in rests], np.int64).reshape(-1, 2)
        for name in ("frames", "absent")
    )
    return {
        "thing": things,
        "from_frame": frames[:, 0],
        "until_frame": frames[:, 1],
        "absent_before": absent[:, 0],
        "absent_after": absent[:, 1],
        "center": np.array([one.center for one in rests], np.float64).reshape(-1, 3),
        "size": np.array([one.size for one in rests], np.float64),
        "gain": np.array([one.gain for one in rests], np.float32),
        "best_frame": np.array([one.frame for one in looks], np.int64),
        "box": np.array([one.box for one in looks], np.int32).reshape(-1, 4),
    }


def _gaussians(rests: Sequence[Rest], scene: Scenery) -> Columns:
    every = Gaussians.concatenate(
        [*(one.gaussians for one in rests), scene.gaussians.select(torch.arange(0))]
    )
    counts = [one.gaussians.count for one in rests]
    stored = {name: getattr(every, name).cpu().numpy() for name in PARAMETERS if name != "features"}
    owner = np.repeat(np.arange(len(rests), dtype=np.int32), counts)
    return {"rest": owner} | stored
