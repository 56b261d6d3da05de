"""The carries and rests that the stages find with true tracks of what moves, in place of SAM2's."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.carries.truth import recording_of
from benchmarks.transient.truth import Truth, read_truth
from benchmarks.true_instances.__main__ import PRESETS, run, write_instances
from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.rests import RESTS
from egosplat.pipeline import config as configuration
from egosplat.progress import track


@contextmanager
def true_tracks(folder: Path) -> Iterator[tuple[Artifact, Artifact]]:
    """Make carries.zarr and rests.zarr of a finished scene from true tracks, for as long as the context lasts."""
    names = ("frames", "poses", "splats")
    *paths, masks = locate(folder, *names, "masks")
    given = dict(zip(names, paths, strict=True))
    config = configuration.resolve({}, PRESETS)
    frames = open_artifact(given["frames"], FRAMES)
    truth = read_truth(recording_of(folder), frames)
    labels = _moving_labels(truth, frames.read("valid"), config["segments"]["min_area"])
    with TemporaryDirectory() as name:
        own = {one: Path(name) / f"{one}.zarr" for one in ("instances", "view_features")}
        counted = track(labels, "writing true tracks", total=frames.shape("rgb")[0])
        write_instances(own["instances"], frames, counted, truth.moves)
        shown = {"frames": given["frames"], "instances": own["instances"]}
        run("view_features", config, **shown, output=own["view_features"])
        carries, rests = Path(name) / "carries.zarr", Path(name) / "rests.zarr"
        run("carries", config, **given, **own, output=carries)
        run("rests", config, **given, **own, masks=masks, carries=carries, output=rests)
        yield open_artifact(carries, CARRIES), open_artifact(rests, RESTS)


def _moving_labels(truth: Truth, valid: NDArray[np.bool_], min_area: float) -> Iterator[NDArray[np.int32]]:
    """(H, W) true labels of what moves in each frame, -1 for all else and for what is smaller than this share of the frame."""
    for labels in truth.all_labels():
        area = np.bincount(labels[valid & (labels >= 0)], minlength=len(truth.names))
        # Label -1 indexes the last entry.
        kept = np.append(truth.moves & (area >= min_area * valid.size), False)
        yield np.where(valid & kept[labels], labels, -1)
