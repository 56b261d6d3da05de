"""The carries that the stage finds with true tracks of what moves, in place of SAM2's."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.carries.truth import recording_of
from benchmarks.transient.truth import read_truth
from egosplat.artifacts import provenance
from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.writer import create
from egosplat.geometry import Array
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import options_of
from egosplat.pipeline.stages import run_stage
from egosplat.progress import track
from egosplat.query.histories import Histories

# Smaller masks are left out, as SAM2's are: the default of segments.min_area.
LEAST_AREA = 0.0005


def with_true_tracks(folder: Path, presets: Path, seconds: Array) -> Histories:
    """The histories of a finished scene from true tracks; ``seconds`` (F,) time of each frame."""
    names = ("frames", "poses", "splats")
    given = dict(zip(names, locate(folder, *names), strict=True))
    config = configuration.resolve({}, presets)
    with TemporaryDirectory() as name:
        own = {one: Path(name) / f"{one}.zarr" for one in ("instances", "view_features", "carries")}
        write_true_tracks(recording_of(folder), given["frames"], own["instances"])
        needed = {"frames": given["frames"], "instances": own["instances"]}
        run_stage("view_features", options_of("view_features", config), **needed, output=own["view_features"])
        needed = given | {key: own[key] for key in ("instances", "view_features")}
        run_stage("carries", options_of("carries", config), **needed, output=own["carries"])
        return Histories(open_artifact(own["carries"], CARRIES), seconds)


def write_true_tracks(recording: Path, frames_path: Path, output: Path) -> None:
    """Write instances.zarr with the true masks of what moves alone, each thing or person a track of all frames."""
    frames = open_artifact(frames_path, FRAMES)
    truth, valid = read_truth(recording, frames), frames.read("valid")
    count, (height, width) = len(truth.names), valid.shape
    with create(output, INSTANCES, provenance.begin_from("instances", {}, [frames])) as artifact:
        artifact.allocate("labels", (frames.shape("rgb")[0], 1, height, width))
        total = frames.shape("rgb")[0]
        for frame, labels in enumerate(track(truth.all_labels(), "writing true tracks", total=total)):
            area = np.bincount(labels[valid & (labels >= 0)], minlength=count)
            kept = np.append(truth.moves & (area >= LEAST_AREA * valid.size), False)
            artifact.put_row(
                "labels", frame, np.where(valid & kept[labels], labels, -1)[None].astype(np.int32)
            )
        artifact.put("instances/level", np.zeros(count, np.int8))
        artifact.put("instances/parent", np.full(count, -1, np.int32))
        artifact.put("instances/masks", np.ones(count, np.int32))
        artifact.put("instances/moving", truth.moves)
        artifact.put("gaussians/xyz", np.zeros((0, 3), np.float32))
        artifact.put("gaussians/instance", np.zeros((0, 1), np.int32))
        artifact.facts = {"levels": ["whole"], "instances": {"whole": count}, "source": "masks"}
