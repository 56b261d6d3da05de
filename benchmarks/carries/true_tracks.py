"""The carries and rests that the stage finds with true tracks of what moves, in place of SAM2's."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.carries.truth import recording_of
from benchmarks.transient.truth import Truth, read_truth
from benchmarks.true_instances.__main__ import PRESETS, run, write_instances
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, HISTORIES
from egosplat.histories.known import Histories, Rests
from egosplat.pipeline import config as configuration
from egosplat.progress import track
from egosplat.query.finished_scene import Scene


def with_true_tracks(scene: Scene) -> tuple[Histories, Rests]:
    """What a finished scene would tell from true tracks."""
    names = ("frames", "poses", "splats")
    *paths, masks = locate(scene.folder, *names, "masks")
    given = dict(zip(names, paths, strict=True))
    config = configuration.resolve({}, PRESETS)
    frames = open_artifact(given["frames"], FRAMES)
    truth = read_truth(recording_of(scene.folder), frames)
    labels = _moving_labels(truth, frames.read("valid"), config["segments"]["min_area"])
    with TemporaryDirectory() as name:
        own = {one: Path(name) / f"{one}.zarr" for one in ("instances", "view_features")}
        counted = track(labels, "writing true tracks", total=len(scene.seconds))
        write_instances(own["instances"], frames, counted, truth.moves)
        shown = {"frames": given["frames"], "instances": own["instances"]}
        run("view_features", config, **shown, output=own["view_features"])
        output = Path(name) / "histories.zarr"
        run("histories", config, **given, **own, masks=masks, output=output)
        histories = open_artifact(output, HISTORIES)
        rests = Rests.read(histories, scene.seconds, scene.gaussians.means.device)
        return Histories(histories, rests, scene.seconds), rests


def _moving_labels(truth: Truth, valid: NDArray[np.bool_], min_area: float) -> Iterator[NDArray[np.int32]]:
    """(H, W) true labels of what moves in each frame, -1 for all else and for what is smaller than this share of the frame."""
    for labels in truth.all_labels():
        area = np.bincount(labels[valid & (labels >= 0)], minlength=len(truth.names))
        # Label -1 indexes the last entry.
        kept = np.append(truth.moves & (area >= min_area * valid.size), False)
        yield np.where(valid & kept[labels], labels, -1)
