"""What happens in recordings: things, carries, rests, and the share of the picture that moves or is hidden.

    snakemake --cores 2 results/adt/{scene1,busy1,foreign1}/recording
    python -m benchmarks.worlds results/adt/{scene1,busy1,foreign1}/recording

Reads the ground truth alone, of synthetic recordings and of ADT's.
"""

from pathlib import Path

import click

from benchmarks.common import command, markdown
from benchmarks.worlds.statistics import Statistics, statistics_of, texts

COLUMNS = {
    "seconds": "seconds",
    "things": "things",
    "seen": "seen",
    "moved": "moved",
    "carried": "carried",
    "places": "places of rest",
    "rest_s": "rest, s",
    "wearer": "arms",
    "others": "other person",
    "movers": "movers",
    "half_hidden": "half hidden once",
    "partly_hidden": "partly hidden",
}


def name_of(recording: Path) -> str:
    """The scene of a recording in a results folder, else the folder's own name."""
    return recording.parent.name if recording.name == "recording" else recording.name


@command(__doc__)
@click.argument(
    "recordings", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path)
)
def main(recordings: tuple[Path, ...]) -> None:
    """Print the table."""
    rows = [[name_of(one.resolve()), *texts(statistics_of(one))] for one in recordings]
    click.echo(markdown(["recording", *(COLUMNS[name] for name in Statistics.__annotations__)], rows))


if __name__ == "__main__":
    main()
