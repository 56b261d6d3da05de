"""Stage ``carries``: what is carried from where to where, from the tracks of what moves (docs/method.md#carries)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import (
    FRAMES,
    INSTANCES,
    POSES,
    SPLATS,
    VIEW_FEATURES,
    camera_poses,
    is_track,
    seconds_of,
)
from egosplat.artifacts.writer import create
from egosplat.carries.depth import SceneDepth
from egosplat.carries.finding import Carry, find_carries
from egosplat.carries.options import CarriesOptions
from egosplat.carries.sightings import see_tracks
from egosplat.codes.vectors import unit
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.geometry import Camera, known_poses
from egosplat.progress import log

# Carries whose features have this cosine show one thing.
_ALIKE = 0.9


def run(
    frames_path: Path,
    poses_path: Path,
    instances_path: Path,
    view_features_path: Path,
    splats_path: Path,
    output: Path,
    options: CarriesOptions,
) -> None:
    """Write the carries of a recording; none where nothing is tracked.

    Raises:
        UserError: the inputs do not belong together, or the backend cannot run.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    instances, splats = open_artifact(instances_path, INSTANCES), open_artifact(splats_path, SPLATS)
    views = open_artifact(view_features_path, VIEW_FEATURES)
    check_made_from(poses, frames, axes=("frame",))
    check_made_from(instances, frames, axes=("frame", "height", "width"))
    check_made_from(splats, frames, poses)
    check_made_from(views, frames, instances)
    inputs = [frames, poses, instances, views, splats]
    record = provenance.begin_from("carries", options.as_dict(), inputs)
    camera, camera_to_world = Camera(**splats.facts["camera"]), camera_poses(poses, splats)
    gaussians = read_gaussians(splats).to(training_device(options.backend))
    settings = read_render_settings(splats, options.backend)
    seen = see_tracks(
        known_poses(camera_to_world),
        lambda frame: instances.row("labels", frame),
        is_track(instances),
        SceneDepth(gaussians, settings, camera, camera_to_world).of,
        camera,
        camera_to_world,
        frames.read("valid"),
    )
    found, tracks = find_carries(seen, seconds_of(frames)), len(np.unique(seen.track))
    log(f"{len(found)} carries in {tracks} tracks of what moves")
    with create(output, CARRIES, record) as artifact:
        for name, values in _columns(found, views).items():
            artifact.put(name, values)
        artifact.facts = {"tracks": tracks}


def _columns(found: Sequence[Carry], views: Artifact) -> dict[str, NDArray]:
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
        "feature": _features(found, views),
    }


def _features(found: Sequence[Carry], views: Artifact) -> NDArray[np.float32]:
    """(C, D) mean feature of the views of each carry and of those that look alike, of unit norm; zeros without views."""
    instance, frame, feature = (views.read(name) for name in ("instance", "frame", "feature"))
    features = np.zeros((len(found), feature.shape[1]), np.float32)
    for number, one in enumerate(found):
        shown = np.isin(instance, [one.track, *one.others]) & np.isin(frame, one.seen.frame)
        features[number] = unit(feature[shown].sum(axis=0, dtype=np.float64))
    # Views of one carry alone often miss its name: a few masks show parts of it.
    alike = features @ features.T >= _ALIKE
    return unit(alike @ features).astype(np.float32)
