"""Whether the survey asks for masks where people are at work, and nowhere else.

    python -m benchmarks.survey results/adt/{scene,busy,foreign}{1,2,3,4,5} results/real/* --still results/real/fox
    python -m benchmarks.survey                   # the table of the page, from its rows

Reads the `survey.json` of scenes, or makes it where there is none, and prints a row of each world; `rows.csv` beside the page has each scene.
People are at work in scenes whose name begins with `busy` and in those of `--people`. In others little moves, or with `--still` nothing.
"""

import json
from pathlib import Path
from typing import Any

import click
import pandas as pd

from benchmarks.common import command, markdown
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES
from egosplat.pipeline.home import title_of
from egosplat.pipeline.running import run_stage

ROWS = Path(__file__).with_name("rows.csv")

COLUMNS = ["recording", "moves", "frames", "px", "lasting", "fleeting", "voting", "min_share", "masked"]


def survey_of(folder: Path) -> dict[str, Any]:
    """Read or make the survey of a scene."""
    path = folder / "survey.json"
    if not path.exists():
        run_stage("survey", frames=folder / "frames.zarr", poses=folder / "poses.zarr", output=path)
    return json.loads(path.read_text())


def row(folder: Path, moves: str) -> list[object]:
    """The values of ``COLUMNS`` of a scene; unknown shares are None."""
    motion, frames = survey_of(folder)["motion"], open_artifact(folder / "frames.zarr", FRAMES)
    shares = [motion[name] for name in ("share", "fleeting", "voting", "min_share")]
    count, *sides, _ = frames.shape("rgb")
    return [title_of(folder), moves, count, max(sides), *shares, motion["masking"] != "none"]


def table(rows: pd.DataFrame) -> str:
    """The table of the page: a row of each world of ADT, and of other data sets, with the lowest and highest shares [%]."""
    group = rows["recording"].str.removeprefix("adt/").str.replace(r"\d*$|/.*", "", regex=True)
    cells = []
    for (name, moves), own in rows.groupby([group, "moves"], sort=False):
        shares = [f"{100 * own[one].min():.2f}–{100 * own[one].max():.2f}" for one in ("lasting", "fleeting")]
        cells.append([name, moves, *shares, f"{own['masked'].sum()}/{len(own)}"])
    return markdown(["recordings", "moves", "keeps moving", "in passing", "masked"], cells)


@command(__doc__)
@click.argument("folders", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option("--still", multiple=True, type=click.Path(exists=True, path_type=Path))
@click.option("--people", multiple=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...], still: tuple[Path, ...], people: tuple[Path, ...]) -> None:
    """Survey, print, and keep the rows."""
    if not (folders or still or people):
        return click.echo(table(pd.read_csv(ROWS)))
    kinds = {folder: "people" if folder.name.startswith("busy") else "little" for folder in folders}
    kinds |= dict.fromkeys(still, "nothing") | dict.fromkeys(people, "people")
    rows = pd.DataFrame([row(*kind) for kind in kinds.items()], columns=COLUMNS)
    rows.to_csv(ROWS, index=False)
    click.echo(table(rows))


if __name__ == "__main__":
    main()
