"""Scores of scenes and of their variants, and paired differences from the full method, for each world.

    snakemake --cores 2 --configfile benchmarks/ablation/config.yaml -- \\
        results/adt/{scene,busy,foreign}{1,2,3,4,5}/{,variants/{frame_masks,plain_mean,own,consistent,no_masks,network_masks}/}metrics.json
    python -m benchmarks.ablation results/adt/{scene,busy,foreign}{1,2,3,4,5} --rows benchmarks/ablation/rows

--variant takes others in place of the ablation's, such as occam, or one of your configuration.
"""

from pathlib import Path

import click

from benchmarks.common import command, scene_folders
from benchmarks.figures import METHOD, chance_line, difference_table, score_table
from benchmarks.rows import collect_page, rows_option
from egosplat_rivals.scored_scenes import FULL

VARIANTS = ("frame_masks", "plain_mean", "own", "consistent", "no_masks", "network_masks")

TABLES = (score_table, difference_table, chance_line)


@command(__doc__)
@scene_folders
@click.option("--variant", "variants", multiple=True, default=VARIANTS, show_default=True)
@rows_option
def main(folders: tuple[Path, ...], variants: tuple[str, ...], rows: Path | None) -> None:
    """Print the tables of each world, named as its scenes are without their numbers."""
    found = collect_page("ablation", folders, {FULL: None, **{name: name for name in variants}}, rows)
    click.echo(METHOD)
    for world in found.worlds:
        click.echo("\n\n".join([f"\n## {world}", *(table(found, world) for table in TABLES)]))


if __name__ == "__main__":
    main()
