"""Scores of finished scenes beside what their camera costs: held-out PSNR with and without corrections, processor time.

snakemake --cores 2 --config synthetic='{camera: real}' -- results/adt/scene{1,2,3,4,5}/metrics.json
python -m benchmarks.real_camera results/adt/scene{1,2,3,4,5}
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.common import command, markdown, scene_folders
from benchmarks.rows import collect_page, rows_option
from benchmarks.scores import METHOD, SCORES, chance, format_score, psnr, seconds
from egosplat.pipeline.home import title_of
from egosplat_rivals.scored_scenes import FULL, ScoredScene, read_scored_scene
from egosplat_rivals.tables.paper_tables import average

COLUMNS = (
    "scene",
    "queries",
    "accuracy",
    "static",
    "movable",
    "mIoU",
    "PSNR, static",
    "without corrections",
    "CPU-min",
)


def psnr_given(scene: ScoredScene) -> float:
    """Static PSNR of held-out frames with the given poses and exposures [dB]; equal to ``psnr`` without corrections."""
    given = scene.document.get("rendering_without_corrections")
    return psnr(scene, "static") if given is None else given["static"]["psnr"]


def values(scenes: Sequence[ScoredScene]) -> list[str]:
    """The last three columns, as means over scenes."""
    psnrs = (
        np.mean([value(one) for one in scenes]) for value in (lambda one: psnr(one, "static"), psnr_given)
    )
    minutes = np.mean([seconds(one) for one in scenes]) / 60
    return [*(f"{one:.2f}" for one in psnrs), f"{minutes:.1f}"]


def table(scenes: Mapping[str, ScoredScene]) -> str:
    """A row for each scene, then the means."""
    rows = []
    for name, scene in scenes.items():
        cells = [scene.cell(*score) for score in SCORES]
        rows.append([name, cells[0].queries, *map(format_score, cells), *values([scene])])
    cells = [average(scenes, *score) for score in SCORES]
    return markdown(
        COLUMNS, [*rows, ["mean", cells[0].queries, *map(format_score, cells), *values([*scenes.values()])]]
    )


@command(__doc__)
@scene_folders
@rows_option
def main(folders: Sequence[Path], rows: Path | None) -> None:
    collect_page("real_camera", folders, {FULL: None}, rows)
    scenes = {title_of(folder): read_scored_scene(folder / "metrics.json") for folder in folders}
    print(f"{METHOD}\n{chance([*scenes.values()])}\n\n{table(scenes)}")


if __name__ == "__main__":
    main()
