"""Scores of scenes and of their variants, and paired differences between variants.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/{,variants/{baseline,no_masks,network_masks}/}metrics.json
    python -m benchmarks.ablation results/adt/scene{1,2,3,4,5} --rows benchmarks/ablation/rows

--variant takes others in place of the ablation's, such as occam, or one of your configuration.
"""

from pathlib import Path

import click

from benchmarks.common import command, scene_folders
from benchmarks.figures import chance_line, difference_table, score_table
from benchmarks.rows import collect_page, rows_option
from benchmarks.scores import METHOD
from egosplat.evaluation.scored_scenes import FULL

VARIANTS = ("baseline", "no_masks", "network_masks")

# Pairs of the ablation's variants whose answers are compared, besides each with the full method.
COMPARED = (("no_masks", "baseline"), ("network_masks", "no_masks"))


@command(__doc__)
@scene_folders
@click.option("--variant", "variants", multiple=True, default=VARIANTS, show_default=True)
@rows_option
def main(folders: tuple[Path, ...], variants: tuple[str, ...], rows: Path | None) -> None:
    """Print the tables."""
    found = collect_page("ablation", folders, {FULL: None, **{name: name for name in variants}}, rows)
    pairs = [pair for pair in COMPARED if set(pair) <= {*variants}]
    click.echo("\n\n".join([METHOD, score_table(found), difference_table(found, pairs), chance_line(found)]))


if __name__ == "__main__":
    main()
