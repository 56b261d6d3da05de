"""Why queries of synthetic scenes are missed: a cause for each.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/metrics.json
    python -m benchmarks.misses results/adt/scene{1,2,3,4,5}

Every frame of a synthetic recording is annotated, so each instance of a scene is compared with the true things. The causes
follow the pipeline, and the first that holds is the one:

- no mask: no instance of which most pixels show the thing covers a tenth of its pixels, over all training frames;
- masked: most of the thing's pixels in training frames are masked as moving;
- no Gaussians: hardly any of its pixels in the query's frame show Gaussians that took its instance's code;
- wrong pixel: the answer is on such Gaussians, but outside of the thing;
- wrong name: another instance matches the words better.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch

from benchmarks.common import command, markdown, scene_folders, survey_of
from benchmarks.transient.truth import read_truth
from egosplat.arrays import Array, Bools, Ints
from egosplat.artifacts.consistency import kept_frames
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS
from egosplat.errors import UserError
from egosplat.evaluation.queries import read_layers
from egosplat.gaussians.render import view_of
from egosplat.gaussians.training_views import open_masking
from egosplat.language.dominant import dominant, sum_votes
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews, select_code_views
from egosplat.pipeline.home import title_of
from egosplat.query.finished_scene import Scene, open_scene
from egosplat.rasterize.view import render_codes
from egosplat_rivals.scored_scenes import read_scored_scene

CAUSES = ("no mask", "masked", "no Gaussians", "wrong pixel", "wrong name")

# Share of a thing's pixels that an instance of it covers, and that its Gaussians have to show in the frame.
LEAST = 0.1


@dataclass(frozen=True)
class Evidence:
    """What became of a thing that a query misses; all numbers are 0..1.

    Attributes:
        covered: share of its pixels in the training frames that one instance of it covers, at best.
        masked: share of its pixels in the training frames that are masked.
        shown: share of its pixels in the query's frame that show Gaussians of its instances, at the best level.
        answered: share of the answered pixel that shows these Gaussians, at the answered level.
    """

    covered: float
    masked: float
    shown: float
    answered: float

    @property
    def cause(self) -> str:
        """The first of ``CAUSES`` that holds."""
        holds = (self.covered < LEAST, self.masked > 0.5, self.shown < LEAST, self.answered > 0.5, True)
        return CAUSES[holds.index(True)]


@dataclass(frozen=True, eq=False)
class Overlap:
    """What I instances share with T true things, over the training frames.

    Attributes:
        covered: (I, T) share of a thing's pixels that an instance covers, if most of the instance shows the thing; else 0.
        masked: (T,) share of each thing's pixels that are masked; 1 for a thing that no training frame shows.
        names: of the things, in the order of annotations.zarr.
    """

    covered: Array
    masked: Array
    names: list[str]


def measure_overlap(scene: Scene, views: CodeViews) -> Overlap:
    """Compare the instances of a scene with the true things of its recording."""
    frames, instances = scene.artifact("frames"), scene.artifact("instances")
    truth = read_truth(frames.path.with_name("recording"), frames)
    count, things = instances.shape("instances/level")[0], len(truth.names)
    # The last row counts all pixels of a thing, the one before those that are masked.
    common, own = np.zeros((count + 2, things)), np.zeros(count)
    row_of = {frame: row for row, frame in enumerate(views.frame.tolist())}
    for frame, labels in enumerate(truth.all_labels()):
        if frame not in row_of:
            continue
        masked = None if views.transient is None else views.transient[row_of[frame]]
        hidden = np.zeros(labels.shape, bool) if masked is None else masked.numpy() > 0.5
        levels = [*instances.row("labels", frame), np.where(hidden, count, -1), 0 * labels + count + 1]
        for level in levels:
            both = (level >= 0) & (labels >= 0) & scene.valid
            np.add.at(common, (level[both], labels[both]), 1)
        for level in levels[:-2]:
            own += np.bincount(level[level >= 0], minlength=count)
    common, (unseen, seen) = common[:-2], common[-2:]
    covered = np.where(common > 0.5 * own[:, None], common / np.maximum(seen, 1), 0.0)
    return Overlap(covered, np.where(seen > 0, unseen / np.maximum(seen, 1), 1.0), truth.names)


def lifted_instances(scene: Scene, views: CodeViews) -> Ints:
    """(N, L) instance whose code each Gaussian took at each level, -1 for none."""
    targets = CodeTargets(scene.artifact("instances"), scene.encoded, views.device)
    (gaussian, instance, _, weight), _ = sum_votes(views, targets)
    found = np.full((scene.gaussians.count, len(targets.levels)), -1)
    for level in range(found.shape[1]):
        best = dominant(gaussian, weight, targets.level[instance] == level)
        found[gaussian[best], level] = instance[best]
    return found


def training_views(scene: Scene) -> CodeViews:
    """The training views of the scene's codes, masked as they were."""
    frames, poses, splats = map(scene.artifact, ("frames", "poses", "splats"))
    transient, masks = locate(scene.folder, "transient", "masks")
    paths = {"transient_path": transient, "masks_path": masks}
    masking = open_masking(splats.provenance["options"]["masking"], frames, paths)
    kept, _ = kept_frames(frames, survey_of(scene.folder))
    given = scene.gaussians, scene.trained.settings
    return select_code_views(frames, poses, splats, None, masking, *given, kept)


def find_causes(folder: Path) -> Iterator[tuple[Mapping[str, Any], Evidence]]:
    """Each missed query of a scored scene, as ``metrics.json`` tells it, and what became of the thing.

    Raises:
        UserError: the scene is not finished, or its codes are not those of instances.
    """
    scene = open_scene(folder)
    if (method := scene.artifact("language").facts["method"]) != "lifted":
        raise UserError(f"{folder}: language.method is {method}; only lifted gives codes of instances")
    views = training_views(scene)
    overlap, lifted = measure_overlap(scene, views), lifted_instances(scene, views)
    annotations = open_artifact(scene.artifact("frames").path.with_name("annotations.zarr"), ANNOTATIONS)
    row_of = {frame: row for row, frame in enumerate(annotations.read("frame").tolist())}
    for query in read_scored_scene(folder / "metrics.json").document["queries"]:
        true = query["groups"].get("all")
        if true is not None and not true["hit"]:
            things = [overlap.names.index(name) for name in true["instances"]]
            target = np.isin(read_layers(annotations, row_of[query["frame"]], scene.valid)[0], things)
            yield query, _measure(scene, query, things, target, overlap, lifted)


def _measure(
    scene: Scene, query: Mapping[str, Any], things: list[int], target: Bools, overlap: Overlap, lifted: Any
) -> Evidence:
    """Evidence of the thing that is covered best, of several that a query may hit."""
    best = things[int(overlap.covered[:, things].max(axis=0).argmax())]
    own = np.flatnonzero((overlap.covered[:, things] >= LEAST).any(axis=1))
    trained, pose = scene.trained, scene.poses[query["frame"]]
    taken = torch.from_numpy(np.isin(lifted, own).astype(np.float32))[..., None]
    view = view_of(trained.gaussians, scene.camera, pose, trained.settings)
    code, _ = render_codes(view, taken, trained.share)
    mine, answered = code[..., 0].numpy(), 0.0
    if query["pixel"] is not None:
        column, row = query["pixel"]
        answered = float(mine[scene.levels.index(query["level"]), row, column])
    shown = float((mine[:, target] > 0.5).mean(axis=1).max())
    return Evidence(float(overlap.covered[:, best].max()), float(overlap.masked[best]), shown, answered)


@command(__doc__)
@scene_folders
@click.option("--each", is_flag=True, help="Also list each missed query.")
def main(folders: tuple[Path, ...], each: bool) -> None:
    """Print the table."""
    rows, listed = [], []
    for folder in folders:
        found = list(find_causes(folder))
        queries = read_scored_scene(folder / "metrics.json").document["scores"]["all"]["count"]
        counts = Counter(evidence.cause for _, evidence in found)
        rows.append([title_of(folder), queries, len(found), *(counts[cause] for cause in CAUSES)])
        for query, one in found:
            numbers = (f"{value:.2f}" for value in vars(one).values())
            listed.append([title_of(folder), query["frame"], query["category"], one.cause, *numbers])
    total = [sum(row[place] for row in rows) for place in range(1, len(rows[0]))]
    click.echo("Missed queries by cause: `python -m benchmarks.misses`.\n")
    click.echo(markdown(["scene", "queries", "missed", *CAUSES], [*rows, ["all", *total]]))
    if each:
        columns = ("scene", "frame", "query", "cause", *Evidence.__dataclass_fields__)
        click.echo(f"\n{markdown(columns, listed, words=4)}")


if __name__ == "__main__":
    main()
