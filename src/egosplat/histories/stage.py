"""Stage ``histories``: what is carried from where to where, Gaussians of what lies somewhere for a while, and which of both are of one
thing (docs/answers.md#carries)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.arrays import Floats
from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.lineage import open_inputs
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import (
    FRAMES,
    HISTORIES,
    INSTANCES,
    MASKS,
    POSES,
    SPLATS,
    VIEW_FEATURES,
    camera_poses,
    lies_on_its_side,
    seconds_of,
)
from egosplat.artifacts.writer import create
from egosplat.gaussians.io import read_exposure, read_trained_scene
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.geometry import known_poses
from egosplat.histories.moves import Carry, find_carries
from egosplat.histories.options import HistoriesOptions
from egosplat.histories.places import Recording, find_views, see_places
from egosplat.histories.rests import Rest, ends_of, find_rests, link
from egosplat.histories.sightings import see_tracks
from egosplat.histories.things import find_things, look_at
from egosplat.language.vectors import unit
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_clip_of
from egosplat.progress import log

# What is always given.
_INPUTS = (FRAMES, POSES, INSTANCES, VIEW_FEATURES, SPLATS)

# Carries whose features have this cosine show one thing.
_ALIKE = 0.9

# Arrays, or lists of their rows, by name.
Columns = dict[str, Any]


def run(*, output: Path, options: HistoriesOptions, **paths: Path | None) -> None:
    """Write the carries and rests of a recording; none where nothing is tracked. Gaussians that were trained with masks need
    them.

    UserError: the inputs do not belong together, the model did not make the features, or the backend cannot run.
    """
    given = open_inputs(paths)
    frames, poses, instances, views, splats = (given[one.name] for one in _INPUTS)
    masks = given.get(MASKS.name)
    check_made_from(poses, frames, axes=("frame",))
    check_made_from(instances, frames, axes=("frame", "height", "width"))
    check_made_from(views, frames, instances)
    check_made_from(splats, frames, poses, *([] if masks is None else [masks]))
    hashes = {CLIP.checkpoint_key: model_hash(CLIP, options.as_dict())}
    record = provenance.begin_from("histories", options.as_dict(), given.values(), hashes)
    scene = read_trained_scene(splats, options.backend)
    trained = scene.gaussians, scene.settings, scene.camera, scene.sh_degree
    told = frames, instances, masks, options.seed, camera_poses(poses, splats), *read_exposure(splats)
    recording = Recording(*trained, *told)
    seconds, posed = seconds_of(frames), known_poses(recording.camera_to_world)
    seen, inside = see_tracks(posed, recording)
    carries, tracks = find_carries(seen, inside, seconds), len(np.unique(seen.track))
    log(f"{len(carries)} carries in {tracks} tracks of what moves")
    ends = ends_of(carries, seconds)
    shown = find_views(ends, posed[frames.read("train")[posed]], seconds, recording)
    rests = find_rests(ends, see_places(ends, shown, recording), seconds, recording)
    columns = _columns_of_carries(carries, views) | _columns_of_rests(rests, recording, views, options)
    links, carried = link(ends, rests, seconds, len(carries)), columns["carries/feature"]
    things, of_carries, features = find_things(rests, columns.pop("rests/feature"), links, carried)
    log(f"{len(rests)} rests of {len(features)} things")
    columns |= {"carries/thing": of_carries, "carries/from_rest": links[0], "carries/to_rest": links[1]}
    columns |= {"rests/thing": things, "things/feature": features}
    with create(output, HISTORIES, record) as artifact:
        for name, rows in columns.items():
            if isinstance(rows, list):
                field = HISTORIES.fields[name]
                # Of no row, too, points have their three numbers.
                rows = np.array(rows, field.dtype).reshape(len(rows), *map(int, field.dims[1:]))
            artifact.put(name, rows)
        artifact.facts = {"tracks": tracks}


def _columns_of_carries(carries: Sequence[Carry], views: Artifact) -> Columns:
    best = [carry.seen[carry.seen.area.argmax()] for carry in carries]
    return {
        "carries/instance": [carry.track for carry in carries],
        "carries/first_frame": [carry.first for carry in carries],
        "carries/last_frame": [carry.last for carry in carries],
        "carries/start": [carry.start for carry in carries],
        "carries/end": [carry.end for carry in carries],
        "carries/size": [carry.size for carry in carries],
        "carries/best_frame": [sighting.frame for sighting in best],
        "carries/box": [sighting.box for sighting in best],
        "carries/feature": _features_of_carries(carries, views),
    }


def _features_of_carries(carries: Sequence[Carry], views: Artifact) -> Floats:
    """(C, D) mean feature of the views of each carry and of those that look alike, of unit norm; zeros without views."""
    instance, frame = views.read("instance"), views.read("frame")
    mine = np.isin(instance, [number for carry in carries for number in (carry.track, *carry.others)])
    parts = [rows[mine[start : start + len(rows)]] for start, rows in views.chunks("feature")]
    features = np.zeros((len(carries), views.shape("feature")[1]), np.float32)
    feature, instance, frame = np.concatenate([features[:0], *parts]), instance[mine], frame[mine]
    for row, carry in zip(features, carries, strict=True):
        shown = np.isin(instance, [carry.track, *carry.others]) & np.isin(frame, carry.seen.frame)
        row[:] = unit(feature[shown].sum(axis=0, dtype=np.float64))
    # Views of one carry alone often miss its name: a few masks show parts of it.
    alike = features @ features.T >= _ALIKE
    return unit(alike @ features).astype(np.float32)


def _columns_of_rests(
    rests: Sequence[Rest], recording: Recording, views: Artifact, options: HistoriesOptions
) -> Columns:
    """The columns of rests and of their Gaussians; OpenCLIP, which made the features of views, is loaded if something rests."""
    looks = []
    if rests:
        files = options.clip_model, options.clip_checkpoint
        clip = load_clip_of(views, *files, options.device, options.precision)
        turned = lies_on_its_side(recording.frames)
        looks = [look_at(rest, clip, turned) for rest in rests]
    empty = recording.gaussians.select(torch.arange(0))
    every = Gaussians.concatenate([*(rest.gaussians for rest in rests), empty])
    names = [name for name in PARAMETERS if name != "features"]
    counts = [rest.gaussians.count for rest in rests]
    return {
        "rests/from_frame": [rest.frames[0] for rest in rests],
        "rests/until_frame": [rest.frames[1] for rest in rests],
        "rests/absent_before": [rest.absent[0] for rest in rests],
        "rests/absent_after": [rest.absent[1] for rest in rests],
        "rests/center": [rest.center for rest in rests],
        "rests/size": [rest.size for rest in rests],
        "rests/gain": [rest.gain for rest in rests],
        "rests/best_frame": [frame for frame, _, _ in looks],
        "rests/box": [box for _, box, _ in looks],
        "rests/feature": [feature for _, _, feature in looks],
        "gaussians/rest": np.repeat(np.arange(len(rests), dtype=np.int32), counts),
    } | {f"gaussians/{name}": getattr(every, name).cpu().numpy() for name in names}
