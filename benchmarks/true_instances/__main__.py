"""The value of consistent features with true tracks: scenes queried with true instances instead of SAM2's.

    snakemake --cores 2 results/adt/scene{2,4,5}/metrics.json
    python -m benchmarks.true_instances results/adt/scene{2,4,5} > benchmarks/true_instances/README.md

Every frame of a synthetic recording is annotated. These instances become `instances.zarr` with one level. View features,
features, language and scores follow from it as usual, on the scene's own Gaussians. `view` supervises with the feature of each
view, `inliers` with the mean of that and the consistent feature, but for outliers.
"""

from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import ROOT, command, scene_folders, survey_of
from benchmarks.figures import METHOD, chance_line, difference, score_table
from benchmarks.rows import collect
from benchmarks.transient.truth import read_truth
from egosplat.artifacts import provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, SPLATS
from egosplat.artifacts.writer import create
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config, stage_values
from egosplat.pipeline.home import title_of
from egosplat.pipeline.running import run_stage
from egosplat.progress import log, track
from egosplat_rivals.scored_scenes import ScoredScene, read_scored_scene

PRESETS = ROOT / "config" / "presets"
TARGETS = ("view", "inliers")


def write_true_instances(folder: Path, output: Path) -> None:
    """Write the annotated instances of a scene as ``instances.zarr``."""
    frames = open_artifact(folder / "frames.zarr", FRAMES)
    truth = read_truth(folder / "recording", frames)
    valid = frames.read("valid")
    labels = [np.where(valid, one, -1) for one in track(list(truth.all_labels()), "reading annotations")]
    write_instances(output, frames, labels, np.zeros(len(truth.names), bool))


def write_instances(
    output: Path, frames: Artifact, labels: Iterable[NDArray[np.int32]], moving: NDArray[np.bool_]
) -> None:
    """Write (H, W) labels of all frames in turn as ``instances.zarr`` of one level; ``moving`` (N,) of its instances."""
    count = len(moving)
    with create(output, INSTANCES, provenance.begin_from("instances", {}, [frames])) as artifact:
        length, height, width, _ = frames.shape("rgb")
        artifact.allocate("labels", (length, 1, height, width))
        for frame, found in enumerate(labels):
            artifact.put_row("labels", frame, found[None].astype(np.int32))
        artifact.put("instances/level", np.zeros(count, np.int8))
        artifact.put("instances/masks", np.ones(count, np.int32))
        artifact.put("instances/moving", moving)
        artifact.put("gaussians/xyz", np.zeros((0, 3), np.float32))
        artifact.put("gaussians/instance", np.zeros((0, 1), np.int32))
        artifact.facts = {
            "levels": ["whole"],
            "instances": {"whole": count},
            "segmenter": "truth",
            "source": "masks",
        }


def score(folder: Path, work: Path, target: str) -> ScoredScene:
    """Scores of a scene with the instances and view features in ``work`` and one of ``TARGETS``."""
    config = configuration.resolve({"features": {"supervision": target}}, PRESETS)
    own = {name: folder / f"{name}.zarr" for name in ("frames", "poses", "annotations", "splats")}
    masking = open_artifact(own["splats"], SPLATS).provenance["options"]["masking"]
    made = {name: work / target / f"{name}.zarr" for name in ("features", "language")}
    run("features", config, view_features=work / "view_features.zarr", output=made["features"])
    run(
        "language",
        config,
        **{name: own[name] for name in ("frames", "poses", "splats")},
        instances=work / "instances.zarr",
        features=made["features"],
        survey=survey_of(folder),
        transient=None,
        masks=folder / "masks.zarr" if masking == "refined" else None,
        output=made["language"],
    )
    scores = work / target / "metrics.json"
    run("metrics", config, **own, **made, title=title_of(folder), method=None, output=scores)
    return read_scored_scene(scores)


def run(stage: str, config: Config, **paths: object) -> None:
    """Run a stage as its rule does."""
    run_stage(stage, **{name: path for name, path in paths.items() if path}, **stage_values(stage, config))


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    found: dict[str, list[ScoredScene]] = {target: [] for target in TARGETS}
    config = configuration.resolve({}, PRESETS)
    with TemporaryDirectory() as name:
        for folder in folders:
            log(f"{folder}")
            work = Path(name, *folder.parts[-2:])
            work.mkdir(parents=True)
            write_true_instances(folder, work / "instances.zarr")
            shown = {"frames": folder / "frames.zarr", "instances": work / "instances.zarr"}
            run("view_features", config, **shown, output=work / "view_features.zarr")
            for target, scenes in found.items():
                scenes.append(score(folder, work, target))
        rows = collect("true_instances", found)
    told = (difference(rows, *reversed(TARGETS), score) for score in ("accuracy", "mean_iou"))
    click.echo(
        f"# Consistent features with true tracks\n\n`python -m benchmarks.true_instances`. {METHOD} {chance_line(rows)}\n\n"
        f"{score_table(rows)}\n\n`inliers` against `view`, in percentage points: accuracy, mIoU {', '.join(told)}."
    )


if __name__ == "__main__":
    main()
