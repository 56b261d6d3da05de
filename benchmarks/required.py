"""What modelling only what a scene requires saves, and what it costs: five apartments, and all of everything anyway.

    S="results/adt/still results/adt/still_few results/adt/people results/adt/people_few results/adt/slow"
    snakemake --cores 2 --configfile benchmarks/required/config.yaml -- \
        $(for s in $S; do echo $s/metrics.json $s/variants/anyway/metrics.json; done)
    python benchmarks/required.py $S > benchmarks/required.md

`anyway` keeps all frames and levels, takes 32 dimensions, and makes network and masks whatever moves. Times are of all
stages that a scene's scores stand on, and of the survey that decided, on processors.
"""

import sys
from pathlib import Path

import click
from scores_bench.comparing import METHOD, accuracy_difference, iou_difference, paired, psnr, seconds

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.errors import UserError
from egosplat.pipeline.survey_file import read_survey
from egosplat.tables.scored_scenes import read_scored_scene

ANYWAY = "variants/anyway"
HEADER = (
    "| scene | objects asked for | moves | frames left out | levels | dimensions | CPU-s | anyway | saved "
    "| accuracy | mIoU | static PSNR |\n| --- | ---: | --- | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
)


def row(folder: Path) -> str:
    """A scene's line."""
    own, anyway = (read_scored_scene(folder / below / "metrics.json") for below in ("", ANYWAY))
    survey = read_survey(folder / "survey.json")
    facts = open_artifact(folder / "segments.zarr", SEGMENTS).facts
    levels = [name for name in facts["levels"] if facts["instances"][name]]
    pair = paired(own, anyway)
    took, would = seconds(own) + survey["provenance"]["cpu_s"], seconds(anyway)
    cells = (
        f"{folder.parent.name}/{folder.name}",
        own.document["counts"]["annotated_instances"],
        "nothing" if survey["motion"]["static"] else "something",
        f"{len(survey['views']['left_out'])} of {survey['poses']['frames']}",
        ", ".join(levels),
        own.document["counts"]["code_channels"],
        f"{took:.0f}",
        f"{would:.0f}",
        f"{1 - took / would:.0%}",
        accuracy_difference([pair]),
        iou_difference([pair]),
        f"{psnr(own, 'static') - psnr(anyway, 'static'):+.2f}",
    )
    return f"| {' | '.join(map(str, cells))} |"


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    click.echo(
        "Only what a scene requires, against all of everything: `benchmarks/required.py`. Differences in percentage "
        f"points and dB of the same queries; above 0 it is better than anyway. {METHOD}\n"
    )
    click.echo(HEADER)
    for folder in folders:
        click.echo(row(folder))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"required.py: {error}")
