"""Public benchmarks: what papers print, and your scores beside it.

    python -m benchmarks.public results/lerf/{figurines,ramen,teatime,waldo_kitchen}
    python -m benchmarks.public --write /tmp/boxes

Without folders it prints the papers' numbers alone. --write makes a small synthetic scene in the format of each benchmark.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click
import pandas as pd

from benchmarks.common import command, markdown
from benchmarks.public.boxes import write_3d_ovs, write_lerf
from egosplat.pipeline.general_options import SHIPPED
from egosplat_rivals.scored_scenes import ScoredScene, check_protocol, read_scored_scene

PRINTED = Path(__file__).with_name("printed.csv")

# Heading, scenes, and what the two numbers of a cell are, by the name of the table.
TABLES = {
    "lerf": (
        "LERF-OVS by LangSplat's evaluation: localization accuracy / mIoU (%)",
        ("figurines", "ramen", "teatime", "waldo_kitchen"),
    ),
    "lerf_points": (
        "LERF-OVS by OpenGaussian's evaluation: accuracy at an IoU of 0.25 / mIoU (%)",
        ("figurines", "ramen", "teatime", "waldo_kitchen"),
    ),
    "3d_ovs": ("3D-OVS: mIoU (%)", ("bed", "bench", "lawn", "room", "sofa")),
}


def printed_rows(table: str) -> Iterator[list[str]]:
    """The rows of the papers: method, a cell for each scene and the mean, source."""
    found = pd.read_csv(PRINTED).query("table == @table")
    for method, rows in found.groupby("method", sort=False):
        cells = {row.scene: _cell(row.accuracy, row.mean_iou) for row in rows.itertuples()}
        yield [
            str(method),
            *(cells.get(scene, "") for scene in (*TABLES[table][1], "mean")),
            rows["source"].iloc[0],
        ]


def own_row(table: str, scenes: Sequence[ScoredScene]) -> list[str]:
    """The row of scored scenes; their mean if all of the table are there."""
    scores = {
        one.scene: [
            one.cell("accuracy", "all").percent if table == "lerf" else None,
            one.cell("mean_iou", "all").percent,
        ]
        for one in scenes
        if one.document["recording"]["kind"] == table
    }
    names = TABLES[table][1]
    if {*names} <= {*scores}:
        scores["mean"] = pd.DataFrame([scores[name] for name in names]).mean().tolist()
    cells = [_cell(*scores[name]) if name in scores else "" for name in (*names, "mean")]
    return ["**EgoSplat, yours**", *cells, "`metrics.json`"]


def deviations(scene: ScoredScene) -> Iterator[str]:
    """The keys of a benchmark's protocol that a scene was made or scored without, with both values."""
    document = scene.document
    made: Mapping[str, object] = document["provenance"]["options"]
    frames = (document["artifacts"].get("frames.zarr") or {}).get("options", {})
    for section, keys in SHIPPED["formats"].get(document["recording"]["kind"], {}).items():
        for key, value in keys.items():
            found = (frames if section == "frames" else made).get(key)
            if found != value:
                yield f"{scene.dataset}/{scene.scene}: {section}.{key} is {found}, in the protocol {value}"


def _cell(accuracy: float | None, mean_iou: float | None) -> str:
    numbers = [f"{one:.1f}" for one in (accuracy, mean_iou) if pd.notna(one)]
    return " / ".join(numbers)


@command(__doc__)
@click.argument("folders", nargs=-1, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--write", type=click.Path(path_type=Path), help="New folder for a scene in each format.")
def main(folders: tuple[Path, ...], write: Path | None) -> None:
    """Print the tables, or write the scenes."""
    if write is not None:
        click.echo(write_lerf(write / "lerf_ovs"))
        click.echo(write_3d_ovs(write / "3d_ovs"))
        return
    scenes = [read_scored_scene(folder / "metrics.json") for folder in folders]
    check_protocol(scenes)
    for table, (heading, names) in TABLES.items():
        rows = [*printed_rows(table)]
        if any(one.document["recording"]["kind"] == table for one in scenes):
            rows.append(own_row(table, scenes))
        click.echo(f"**{heading}**\n\n{markdown(('method', *names, 'mean', 'printed in'), rows)}\n")
    for line in (line for scene in scenes for line in deviations(scene)):
        click.echo(f"Not by the protocol: {line}.")


if __name__ == "__main__":
    main()
