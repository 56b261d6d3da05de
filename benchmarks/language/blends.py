"""What blending costs: codes of Gaussians as means or of one instance each, codes or relevancies rendered.

    python -m benchmarks.language.blends results/adt/scene{1,3}

Takes finished scenes, of which everything but the codes stays as it is, and asks the same queries of each combination.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.common import command, markdown, scene_folders, scene_name
from benchmarks.language.__main__ import CPU
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.language import GAUSSIANS, LANGUAGE, PIXELS
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.codes.targets import CodeTargets
from egosplat.evaluation.evaluation_frames import Evaluation, find_asked_queries, read_evaluation
from egosplat.evaluation.queries import Query
from egosplat.evaluation.run_queries import run_queries
from egosplat.evaluation.stage import MetricsOptions
from egosplat.gaussians.pixel_weights import open_masking
from egosplat.language.dominant import lifted
from egosplat.language.lifting import Lifted, lift
from egosplat.language.result import Coded
from egosplat.language.views import select_code_views
from egosplat.query.scene import QueryScene, read_scene
from egosplat.query.text import Texts, encode_texts, load_clip_of
from egosplat.tables.scored_scenes import read_scored_scene

MEANS, ONE = "mean of the codes of its pixels", "code of the instance that it shows most"
RENDERED = {PIXELS: "codes; pixels are decoded", GAUSSIANS: "relevancies of Gaussians"}
COLUMNS = (
    "scene",
    "code of a Gaussian",
    "rendered",
    "queries",
    "accuracy",
    "mIoU",
    "CPU time of the queries [s]",
)


@dataclass(frozen=True, eq=False)
class Asked:
    """A finished scene with its evaluation queries."""

    scene: QueryScene
    evaluation: Evaluation
    queries: list[Query]
    texts: Texts
    options: MetricsOptions


def read(folder: Path) -> tuple[Asked, dict[str, Lifted | Coded]]:
    """Open a finished scene, and give its Gaussians codes in both ways."""
    kinds = (FRAMES, POSES, ANNOTATIONS, SPLATS, LANGUAGE, FEATURES, INSTANCES)
    opened = {kind.name: open_artifact(folder / f"{kind.name}.zarr", kind) for kind in kinds}
    frames, poses, annotations, splats, language, features, instances = opened.values()
    used = read_scored_scene(folder / "metrics.json").document["provenance"]["options"]
    given = {key: tuple(value) if isinstance(value, list) else value for key, value in used.items()}
    options = MetricsOptions(**{key: given[key] for key in MetricsOptions.__dataclass_fields__})
    evaluation = read_evaluation(frames, poses, annotations, splats)
    queries = find_asked_queries(annotations, evaluation.valid, options, evaluation.frames)
    clip = load_clip_of(features, options.clip_model, options.clip_checkpoint, "cpu", options.precision)
    texts = encode_texts(clip, sorted({query.category for query in queries}), options.canonical)
    scene = read_scene(splats, language, features, "auto")
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in ("transient", "masks")}
    masking = open_masking(splats.provenance["options"]["masking"], frames, **paths)
    targets = CodeTargets(instances, features, CPU)
    views = select_code_views(frames, poses, targets.of, masking, CPU)
    views = replace(views, camera_to_world=camera_poses(poses, splats)[views.frame])
    given_to = scene.gaussians, views, scene.settings
    ways = {MEANS: lift(*given_to), ONE: lifted(*given_to, targets)}
    return Asked(scene, evaluation, queries, texts, options), ways


def rows(folder: Path) -> Iterator[tuple[object, ...]]:
    """The rows of one scene."""
    asked, ways = read(folder)
    for name, codes in ways.items():
        for decoded, rendered in RENDERED.items():
            scene = replace(asked.scene, code=codes.code, share=codes.share, decoded=decoded)
            begun, hit_region = time.process_time(), asked.options.hit_region
            answers = run_queries(
                asked.queries, asked.evaluation, scene, asked.texts, asked.options, hit_region
            )
            found = [answer.score.groups["all"] for answer in answers]
            spent = time.process_time() - begun
            scores = (f"{100 * np.mean([getattr(one, key) for one in found]):.1f}" for key in ("hit", "iou"))
            yield scene_name(folder), name, rendered, len(found), *scores, f"{spent:.1f}"


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    print(markdown(COLUMNS, (row for folder in folders for row in rows(folder)), words=3))


if __name__ == "__main__":
    main()
