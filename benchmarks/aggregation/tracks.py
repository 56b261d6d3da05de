"""True tracks of synthetic recordings, tracks of which a share of the views shows one other thing, and how far real tracks slip."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.transient.truth import read_truth
from benchmarks.true_instances.__main__ import PRESETS, run, write_true_instances
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, VIEW_FEATURES
from egosplat.pipeline import config as configuration

LEAST_VIEWS = 6

Features = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Tracks:
    """R views of N things: (N,) scene and category of each, the (R,) thing of each view, ascending, and its (R, D) feature."""

    scene: NDArray[np.int64]
    name: NDArray[np.str_]
    thing: NDArray[np.int64]
    feature: Features


def read_tracks(folders: Sequence[Path], names: set[str]) -> Tracks:
    """Annotated instances with one of these categories and enough views, as stage ``view_features`` encodes them."""
    scenes, found, things, features = [], [], [], []
    config = configuration.resolve({}, PRESETS)
    for scene, folder in enumerate(folders):
        frames = folder / "frames.zarr"
        with TemporaryDirectory() as name:
            instances, output = Path(name) / "instances.zarr", Path(name) / "view_features.zarr"
            write_true_instances(folder, instances)
            run("view_features", config, frames=frames, instances=instances, output=output)
            views = open_artifact(output, VIEW_FEATURES)
            instance, feature = views.read("instance"), views.read("feature")
        for number, category in enumerate(
            read_truth(folder / "recording", open_artifact(frames, FRAMES)).categories
        ):
            own = instance == number
            if category in names and own.sum() >= LEAST_VIEWS:
                things.append(np.full(own.sum(), len(found)))
                features.append(feature[own])
                scenes.append(scene)
                found.append(category)
    return Tracks(np.array(scenes), np.array(found), np.concatenate(things), np.concatenate(features))


def slipped_tracks(tracks: Tracks, share: float, rng: np.random.Generator) -> Features:
    """(R, D) features with this share of each thing's views replaced by views of one other thing of its scene."""
    features = tracks.feature.copy()
    for thing, name in enumerate(tracks.name):
        rows = np.flatnonzero(tracks.thing == thing)
        wrong = rng.permutation(rows)[: round(share * len(rows))]
        others = np.flatnonzero((tracks.scene == tracks.scene[thing]) & (tracks.name != name))
        if len(others):
            shown = np.flatnonzero(tracks.thing == rng.choice(others))
            features[wrong] = tracks.feature[rng.choice(shown, len(wrong))]
    return features


def shares_of_others(
    folder: Path, instances: Path
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Of N instances the (N,) views, the share of these that show another thing, and that show the one most frequent of these.

    A view shows the thing of most of its pixels, an instance that of most of its views. Training frames count.
    """
    frames, found = open_artifact(folder / "frames.zarr", FRAMES), open_artifact(instances, INSTANCES)
    truth = read_truth(folder / "recording", frames)
    counts = np.zeros((found.shape("instances/level")[0], len(truth.names) + 1), np.int64)
    things = list(truth.all_labels())
    for frame in np.flatnonzero(frames.read("train")):
        for level in found.row("labels", frame):
            seen = level >= 0
            pixels = np.zeros_like(counts)
            np.add.at(pixels, (level[seen], things[frame][seen]), 1)  # -1 is the last column
            shown = np.flatnonzero(pixels.any(axis=1))
            counts[shown, pixels[shown].argmax(axis=1)] += 1
    ordered = np.sort(counts[counts.sum(axis=1) >= LEAST_VIEWS], axis=1)
    views = ordered.sum(axis=1)
    return views, 1 - ordered[:, -1] / views, ordered[:, -2] / views
