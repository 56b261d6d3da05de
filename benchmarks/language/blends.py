"""What blending costs: codes of Gaussians as means or of one instance each, codes or relevancies rendered.

    python -m benchmarks.language.blends results/adt/scene{1,3}

Takes finished scenes, of which everything but the codes stays as it is, and asks the same queries of each combination.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from torch import Tensor

from benchmarks.common import command, markdown, scene_folders
from benchmarks.language.__main__ import read as read_learnt
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.options import MetricsOptions, recorded_options
from egosplat.evaluation.queries import Query
from egosplat.evaluation.scores import ask_of, run_queries
from egosplat.language.dominant import lift_instances
from egosplat.language.lifting import lift
from egosplat.pipeline.home import title_of
from egosplat.query.views import Asker
from egosplat.report.sheets.queries_sheet import evaluation_of, open_scored
from egosplat_rivals.scored_scenes import read_scored_scene

MEANS, ONE = "mean of the codes of its pixels", "code of the instance that it shows most"
RENDERED = {"pixels": "codes; pixels are decoded", "gaussians": "relevancies of Gaussians"}
COLUMNS = ("scene", "code of a Gaussian", "rendered", "queries", "accuracy", "mIoU", "CPU time [s]")


@dataclass(frozen=True, eq=False)
class Asked:
    """A finished scene with its evaluation queries."""

    asker: Asker
    evaluation: Evaluation
    queries: list[Query]
    options: MetricsOptions


def read(folder: Path) -> tuple[Asked, dict[str, tuple[Tensor, Tensor]]]:
    """Open a finished scene, and give its Gaussians codes in both ways."""
    learnt, scored = read_learnt(folder), read_scored_scene(folder / "metrics.json")
    options = recorded_options(scored.document["provenance"]["options"])
    scene = open_scored(folder, options)
    evaluation = evaluation_of(scene)
    queries = evaluation.find_queries(options)
    asker = scene.asker(sorted({query.category for query in queries}))
    one = lift_instances(learnt.views, learnt.targets)
    ways = {MEANS: lift(learnt.views), ONE: (one.code, one.share)}
    return Asked(asker, evaluation, queries, options), ways


def rows(folder: Path) -> Iterator[tuple[object, ...]]:
    """The rows of one scene."""
    asked, ways = read(folder)
    for name, (code, share) in ways.items():
        scene = replace(asked.asker.scene, code=code, share=share)
        for readout, rendered in RENDERED.items():
            begun, evaluation = time.process_time(), asked.evaluation
            asker = Asker(scene, asked.asker.texts, asked.options.change(readout=readout))
            ask = ask_of(evaluation, asker)
            answers = run_queries(asked.queries, ask, evaluation.annotations, evaluation.valid, asked.options)
            found = [answer.groups["all"] for answer in answers]
            spent = time.process_time() - begun
            scores = (f"{100 * np.mean([getattr(one, key) for one in found]):.1f}" for key in ("hit", "iou"))
            yield title_of(folder), name, rendered, len(found), *scores, f"{spent:.1f}"


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    print(markdown(COLUMNS, (row for folder in folders for row in rows(folder)), words=3))


if __name__ == "__main__":
    main()
