"""Stage ``rests``: Gaussians of what lies somewhere for a while, and which rests and carries are of one thing
(docs/method.md#rests)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.rests import RESTS
from egosplat.artifacts.schemas import (
    FRAMES,
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
from egosplat.carries.depth import SceneDepth
from egosplat.gaussians.io import STORED, read_exposure
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import known_poses
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.progress import log
from egosplat.query.scene import read_trained_scene
from egosplat.query.text import load_clip_of
from egosplat.rests.finding import Rest, ends_of, find_rests, link, places_of
from egosplat.rests.options import RestsOptions
from egosplat.rests.things import Look, features_of, group, look_at, match
from egosplat.rests.views import Recording, Scenery, see_places


def run(
    frames_path: Path,
    poses_path: Path,
    instances_path: Path,
    view_features_path: Path,
    splats_path: Path,
    carries_path: Path,
    output: Path,
    options: RestsOptions,
    *,
    masks_path: Path | None = None,
) -> None:
    """Write the rests of a recording; none where nothing is carried.

    Args:
        masks_path: required if the Gaussians were trained with refined masks.

    Raises:
        UserError: the inputs do not belong together, the model did not make the features, or the backend cannot run.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    instances, splats = open_artifact(instances_path, INSTANCES), open_artifact(splats_path, SPLATS)
    views, carries = open_artifact(view_features_path, VIEW_FEATURES), open_artifact(carries_path, CARRIES)
    masks = () if masks_path is None else (open_artifact(masks_path, MASKS),)
    check_made_from(poses, frames, axes=("frame",))
    check_made_from(instances, frames, axes=("frame", "height", "width"))
    check_made_from(splats, frames, poses, *masks)
    check_made_from(carries, frames, instances, views, splats)
    inputs = [frames, poses, instances, views, splats, carries, *masks]
    model = {CLIP.config_key: options.clip_model, CLIP.checkpoint_key: options.clip_checkpoint}
    hashes = {CLIP.checkpoint_key: model_hash(CLIP, model)}
    record = provenance.begin_from("rests", options.as_dict(), inputs, hashes)
    trained, seconds = read_trained_scene(splats, options.backend), seconds_of(frames)
    log_gains, compression = read_exposure(splats)
    scene = Scenery(trained.gaussians, trained.settings, trained.sh_degree, compression)
    camera_to_world = camera_poses(poses, splats)
    recording = Recording(
        lambda frame: frames.row("rgb", frame),
        lambda frame: instances.row("labels", frame),
        _moving(instances, masks),
        SceneDepth(trained.gaussians, trained.settings, trained.camera, camera_to_world).of,
        lambda frame: None if log_gains is None else log_gains[frame],
        frames.read("valid"),
        trained.camera,
        camera_to_world,
    )
    ends = ends_of(carries, seconds)
    places = places_of(ends)
    known = known_poses(camera_to_world)
    seen = see_places(places, known[frames.read("train")[known]], recording, scene)
    rests = find_rests(ends, places, seen, seconds, scene, options.seed)
    links = link(ends, places, rests, seconds, len(carries.read("instance")))
    things, of_carries = group(len(rests), links)
    looks: list[Look] = []
    if rests:
        clip = load_clip_of(
            views, options.clip_model, options.clip_checkpoint, options.device, options.precision
        )
        looks = [look_at(one, scene, clip, lies_on_its_side(frames)) for one in rests]
        parts = _features(things, looks, of_carries, carries)
        things, of_carries = match(things, of_carries, rests, parts)
    log(f"{len(rests)} rests of {things.max(initial=-1) + 1} things, at {len(ends)} ends of carries")
    with create(output, RESTS, record) as artifact:
        for name, values in {
            **_columns(rests, things, looks),
            "carries/thing": of_carries,
            "carries/from_rest": links[0],
            "carries/to_rest": links[1],
            "things/feature": _features(things, looks, of_carries, carries),
            **_gaussians(rests, scene),
        }.items():
            artifact.put(name, values)


def _moving(
    instances: Artifact, masks: Sequence[Artifact]
) -> Callable[[int, NDArray[np.int32]], NDArray[np.bool_]]:
    """Tell the pixels of what moves in a frame with these labels: tracks, and refined masks if there are any."""
    # Label -1 indexes the last entry.
    tracks = np.append(is_track(instances), False)

    def of(frame: int, labels: NDArray[np.int32]) -> NDArray[np.bool_]:
        return np.logical_or.reduce(
            [tracks[labels].any(axis=0), *(one.row("refined", frame) for one in masks)]
        )

    return of


def _columns(rests: Sequence[Rest], things: NDArray[np.int32], looks: Sequence[Look]) -> dict[str, NDArray]:
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


def _features(
    things: NDArray[np.int32],
    looks: Sequence[Look],
    of_carries: NDArray[np.int32],
    carries: Artifact,
) -> NDArray[np.float32]:
    carried = carries.read("feature")
    if not looks:
        return np.zeros((0, carried.shape[1]), np.float32)
    return features_of(things, looks, of_carries, carried)


def _gaussians(rests: Sequence[Rest], scene: Scenery) -> dict[str, NDArray]:
    every = Gaussians.concatenate(
        [*(one.gaussians for one in rests), scene.gaussians.select(torch.arange(0))]
    )
    counts = [one.gaussians.count for one in rests]
    stored = {name: getattr(every, name).cpu().numpy() for name in STORED if name != "features"}
    owner = np.repeat(np.arange(len(rests), dtype=np.int32), counts)
    return {"gaussians/rest": owner} | {f"gaussians/{name}": values for name, values in stored.items()}
