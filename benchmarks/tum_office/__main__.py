"""A plain recording of TUM's freiburg3 office: photographs, calibration, and the instances that were drawn by hand.

    python -m benchmarks.tum_office PICTURES [OUT]

PICTURES holds the recording's pictures (the folder rgb of rgbd_dataset_freiburg3_long_office_household); the 17 that
benchmarks/tum_office/polygons.json names are copied. OUT is made, data/tum_office unless told.
"""

import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from egosplat.errors import UserError
from egosplat.files import atomic_directory, read_json

HERE = Path(__file__).resolve().parent
# Where tum_office/scenes.tsv looks for it.
RECORDING = Path("data/tum_office")

# TUM's freiburg3, without distortion. TUM counts from the middle of the top left pixel, egosplat from its
# corner.
CAMERA = {"width": 640, "height": 480, "fx": 535.4, "fy": 539.2, "cx": 320.1 + 0.5, "cy": 247.6 + 0.5}


@dataclass(frozen=True)
class Outline:
    """One polygon of a picture.

    Attributes:
        id: of the instance, as in instances.tsv.
        points: (N, 2) int32, column and row of the pixels of its outline, which belong to it.
    """

    id: int
    points: NDArray[np.int32]


@dataclass(frozen=True)
class Drawing:
    """The drawn instances.

    Attributes:
        width, height: of the pictures [px].
        pictures: names of the recording's pictures, in order.
        outlines: of each picture that was drawn; later ones lie over earlier ones.
    """

    width: int
    height: int
    pictures: list[str]
    outlines: dict[str, list[Outline]]


def parse_drawing(document: dict[str, Any]) -> Drawing:
    """The drawing that polygons.json holds."""
    outlines = {
        name: [Outline(entry["id"], np.array(entry["polygon"], np.int32)) for entry in entries]
        for name, entries in document["polygons"].items()
    }
    return Drawing(document["width"], document["height"], document["pictures"], outlines)


def rasterize(outlines: list[Outline], width: int, height: int) -> NDArray[np.uint8]:
    """(height, width) instance ids; 0 where nothing is drawn."""
    ids = np.zeros((height, width), np.uint8)
    for outline in outlines:
        cv2.fillPoly(ids, [outline.points], outline.id)
    return ids


def check_pictures(folder: Path, drawing: Drawing) -> None:
    """Check that a folder holds the pictures that were drawn.

    Raises:
        UserError: one is missing, or of another size.
    """
    size = (drawing.width, drawing.height)
    for name in drawing.pictures:
        if not (folder / name).is_file():
            raise UserError(f"{folder / name}: not found. Give the folder rgb of TUM's sequence.")
        try:
            with Image.open(folder / name) as picture:
                found = picture.size
        except OSError as error:
            raise UserError(f"{folder / name}: not an image that can be read ({error}).") from error
        if found != size:
            raise UserError(f"{folder / name}: {found[0]}x{found[1]} px, but {size[0]}x{size[1]} were drawn.")


def write_recording(pictures: Path, output: Path, drawing: Drawing) -> None:
    """Write the plain recording (docs/recordings.md).

    Raises:
        UserError: a picture is missing or does not fit, or ``output`` exists.
    """
    if output.exists():
        raise UserError(f"{output}: exists already. Remove it, or give another folder.")
    check_pictures(pictures, drawing)
    with atomic_directory(output) as folder:
        for name in drawing.pictures:
            shutil.copyfile(pictures / name, folder / name)
        (folder / "camera.json").write_text(json.dumps(CAMERA) + "\n")
        annotations = folder / "annotations"
        annotations.mkdir()
        shutil.copyfile(HERE / "instances.tsv", annotations / "instances.tsv")
        for name, outlines in drawing.outlines.items():
            ids = rasterize(outlines, drawing.width, drawing.height)
            Image.fromarray(ids).save((annotations / name).with_suffix(".png"))


@click.command(help=__doc__)
@click.argument("pictures", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("out", default=RECORDING, type=click.Path(path_type=Path))
def main(pictures: Path, out: Path) -> None:
    """Make the recording, and print the next command."""
    write_recording(pictures, out, parse_drawing(read_json(HERE / "polygons.json")))
    if out != RECORDING:
        click.echo(f"Write {out} into the column recording of benchmarks/tum_office/scenes.tsv, then run")
    click.echo(
        "snakemake --cores 2 --configfile benchmarks/tum_office/config.yaml -- results/tum/office/metrics.json"
    )


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"tum_office.py: {error}")
