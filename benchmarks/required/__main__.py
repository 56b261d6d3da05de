"""Processor time saved, and scores lost, by computing only what a scene requires.

    S="results/adt/still results/adt/still_few results/adt/people results/adt/people_few results/adt/slow"
    snakemake --cores 2 --configfile benchmarks/required/config.yaml -- \
        $(for s in $S; do echo $s/metrics.json $s/variants/anyway/metrics.json; done)
    python -m benchmarks.required $S > benchmarks/required/README.md

The variant `anyway` keeps all frames and levels, uses 32 dimensions, and always trains the transient network and makes masks.
Times are processor times of all stages behind a scene's scores, with the survey.
"""

from pathlib import Path

import click

from benchmarks.common import command, markdown, scene_folders
from benchmarks.figures import METHOD, difference, psnr
from benchmarks.rows import Rows, collect_page, rows_option, world_of
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import INSTANCES
from egosplat.pipeline.home import title_of
from egosplat.pipeline.validation import read_document
from egosplat_rivals.scored_scenes import FULL

ANYWAY = "anyway"


def row(folder: Path, rows: Rows) -> dict[str, object]:
    """A scene's cells by column."""
    own, anyway = (rows.of("runs", setting) for setting in (FULL, ANYWAY))
    survey = read_document(folder / "survey.json", "survey")
    facts = open_artifact(folder / "instances.zarr", INSTANCES).facts
    took, would = own["cpu_s"].sum(), anyway["cpu_s"].sum() - survey["provenance"]["cpu_s"]
    return {
        "scene": title_of(folder),
        "motion": "left out" if survey["motion"]["masking"] == "none" else "masked",
        "levels": ", ".join(name for name in facts["levels"] if facts["instances"][name]),
        "frames left out": f"{len(survey['views']['left_out'])} of {survey['poses']['frames']}",
        "CPU-s": f"{took:.0f}",
        "anyway": f"{would:.0f}",
        "saved": f"{1 - took / would:.0%}",
        "accuracy": difference(rows, FULL, ANYWAY, "accuracy"),
        "mIoU": difference(rows, FULL, ANYWAY, "mean_iou"),
        "static PSNR": psnr(rows, FULL, "static"),
        "anyway's": psnr(rows, ANYWAY, "static"),
    }


@command(__doc__)
@scene_folders
@rows_option
def main(folders: tuple[Path, ...], rows: Path | None) -> None:
    """Print the table."""
    found = collect_page("required", folders, {FULL: None, ANYWAY: ANYWAY}, rows)
    cells = [row(folder, found.within(world_of(title_of(folder)))) for folder in folders]
    click.echo(
        "# Only what a scene requires\n\nAgainst computing everything: `python -m benchmarks.required`. Differences on the "
        f"same queries in percentage points; above 0, the scene is better than `anyway`. {METHOD}\n"
    )
    click.echo(markdown(list(cells[0]), [list(one.values()) for one in cells], words=3))


if __name__ == "__main__":
    main()
