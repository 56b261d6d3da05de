"""Public benchmarks: what papers print, and your scores beside it.

    python -m benchmarks.public results/lerf/{figurines,ramen,teatime,waldo_kitchen}
    python -m benchmarks.public --write /tmp/boxes
    python -m benchmarks.public --fetch data

Without folders it prints the papers' numbers alone. --write makes a small synthetic scene in the format of each benchmark. --fetch
fetches LERF-OVS, and writes the settings of ``make public``.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click
import pandas as pd
import yaml

from benchmarks.common import command, markdown
from benchmarks.public.boxes import write_3d_ovs, write_lerf
from egosplat.files import read_json, write_text
from egosplat.models.needed import Needed, download
from egosplat.pipeline.general_options import SHIPPED
from egosplat.pipeline.model_sets import DEFAULTS, LIGHT, PublishedModel
from egosplat.query.options import QueryOptions
from egosplat.run.sources import unpack
from egosplat.transient.options import TransientOptions
from egosplat_rivals.scored_scenes import FULL, ScoredScene, check_protocol, read_scored_scene

PRINTED = Path(__file__).with_name("printed.csv")

# LangSplat's relabeled LERF on the hub, with the license and the digest of its page there.
LERF_OVS = PublishedModel(
    *("data", "lerf_ovs", "four scenes", "lerf_ovs.zip", "datasets/Qmh/lerf_ovs", "lerf_ovs.zip"),
    *("dd6993bbbbc75140ca4ff7751466f132b1fb916b", "BSD-2-Clause", 745.6),
    "0cb250fce178e4e132faf56c9de00e058094ae36cf8d2b6deac0558b5e59374d",
)

# Heading, scenes, and what the two numbers of a cell are, by the name of the table.
SCENES = ("figurines", "ramen", "teatime", "waldo_kitchen")
TABLES = {
    "lerf": ("LERF-OVS by LangSplat's evaluation: localization accuracy / mIoU (%)", SCENES),
    "lerf_points": ("LERF-OVS by OpenGaussian's evaluation: accuracy at an IoU of 0.25 / mIoU (%)", SCENES),
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


def fetch(folder: Path) -> Path:
    """Fetch LERF-OVS into a folder, and write the settings with which ``make public`` makes its scenes."""
    archive = folder / LERF_OVS.file
    download([Needed("", archive, "LERF-OVS", published=LERF_OVS)])
    labels = [*unpack(archive, folder / "lerf_ovs").rglob("label/*/frame_*.json")]
    objects = (one for path in labels for one in read_json(path)["objects"])
    # What a user gets who sets nothing; and a fit of grades holds for the keys of such queries alone.
    usual = {"extends": "balanced", "models": {"set": LIGHT}, "transient": {"lr": TransientOptions().lr}}
    usual["query"] = {"readout": QueryOptions().readout}
    own = {"query": DEFAULTS[LIGHT]["query"] | {"box_filter": QueryOptions().box_filter}}
    settings = {
        "preset": "paper",
        "data_root": {"lerf": str(labels[0].parents[2].absolute())},
        "variants": {"usual": usual, "asked": own, "usual_asked": {"extends": "usual"} | own},
        # A thing of another scene is absent: grades are fitted to both.
        "formats": {"lerf": {"presence": {"negatives": sorted({one["category"] for one in objects})}}},
    }
    write_text(folder / "public.yaml", yaml.safe_dump(settings))
    return folder / "public.yaml"


def own_row(table: str, scenes: Sequence[ScoredScene], variant: str = "") -> list[str]:
    """The row of scored scenes of a variant; their mean if all of the table are there."""
    scores = {
        one.scene: [
            one.cell("accuracy", "all").percent if table == "lerf" else None,
            one.cell("mean_iou", "all").percent,
        ]
        for one in scenes
    }
    names = TABLES[table][1]
    if {*names} <= {*scores}:
        scores["mean"] = pd.DataFrame([scores[name] for name in names]).mean().tolist()
    cells = [_cell(*scores[name]) if name in scores else "" for name in (*names, "mean")]
    return [f"**EgoSplat, yours{variant}**", *cells, "`metrics.json`"]


def deviations(scene: ScoredScene) -> Iterator[str]:
    """The keys of a benchmark's protocol that a scene was made or scored without, with both values."""
    document = scene.document
    made: Mapping[str, object] = document["provenance"]["options"]
    frames = (document["artifacts"].get("frames.zarr") or {}).get("options", {})
    for section, keys in SHIPPED["formats"].get(document["recording"]["kind"], {}).items():
        # What is absent decides no score of a table.
        for key, value in keys.items() if section != "presence" else ():
            found = (frames if section == "frames" else made).get(key)
            if found != value:
                yield f"{document['scene']}: {section}.{key} is {found}, in the protocol {value}"


def _cell(accuracy: float | None, mean_iou: float | None) -> str:
    numbers = [f"{one:.1f}" for one in (accuracy, mean_iou) if pd.notna(one)]
    return " / ".join(numbers)


@command(__doc__)
@click.argument("folders", nargs=-1, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--write", type=click.Path(path_type=Path), help="New folder for a scene in each format.")
@click.option("--fetch", "into", type=click.Path(path_type=Path), help="Folder for LERF-OVS.")
def main(folders: tuple[Path, ...], write: Path | None, into: Path | None) -> None:
    """Print the tables, write the scenes, or fetch the data."""
    if into is not None:
        return click.echo(fetch(into))
    if write is not None:
        click.echo(write_lerf(write / "lerf_ovs"))
        return click.echo(write_3d_ovs(write / "3d_ovs"))
    scenes = [read_scored_scene(folder / "metrics.json") for folder in folders]
    check_protocol(scenes)
    for table, (heading, names) in TABLES.items():
        rows = [*printed_rows(table)]
        own = [one for one in scenes if one.document["recording"]["kind"] == table]
        for variant in dict.fromkeys(one.variant for one in own):
            told = "" if variant == FULL else f", {variant}"
            rows.append(own_row(table, [one for one in own if one.variant == variant], told))
        click.echo(f"**{heading}**\n\n{markdown(('method', *names, 'mean', 'printed in'), rows)}\n")
    for line in (line for scene in scenes for line in deviations(scene)):
        click.echo(f"Not by the protocol: {line}.")


if __name__ == "__main__":
    main()
