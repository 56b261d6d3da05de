"""The desk as a plain recording with the outlines of its things, which were drawn by hand, for its scores.

    python -m benchmarks.real_pictures.desk PICTURES

PICTURES is the folder rgb of rgbd_dataset_freiburg3_long_office_household. Its 17 pictures go to data/tum_office.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.common import command
from benchmarks.real_pictures.boxes import HERE
from egosplat.errors import UserError
from egosplat.files import atomic_directory, read_json

DRAWN = read_json(HERE / "polygons.json")

# TUM's freiburg3, without distortion. TUM counts from the middle of the top left pixel.
CAMERA = {"width": 640, "height": 480, "fx": 535.4, "fy": 539.2, "cx": 320.1 + 0.5, "cy": 247.6 + 0.5}


def rasterize(outlines: list[dict[str, Any]], width: int, height: int) -> NDArray[np.uint8]:
    """(height, width) instance ids; 0 where nothing is drawn. Outlines belong to what they enclose; later ones lie on top."""
    ids = np.zeros((height, width), np.uint8)
    for outline in outlines:
        cv2.fillPoly(ids, [np.array(outline["polygon"], np.int32)], outline["id"])
    return ids


def write_recording(pictures: Path, output: Path) -> None:
    """Write the plain recording (UserError: a picture is missing, or ``output`` exists)."""
    if output.exists():
        raise UserError(f"{output}: exists already. Remove it, or give another folder.")
    with atomic_directory(output) as folder:
        for name in DRAWN["pictures"]:
            if not (pictures / name).is_file():
                raise UserError(f"{pictures / name}: not found. Give the folder rgb of TUM's sequence.")
            shutil.copyfile(pictures / name, folder / name)
        (folder / "camera.json").write_text(json.dumps(CAMERA) + "\n")
        (annotations := folder / "annotations").mkdir()
        shutil.copyfile(HERE / "instances.tsv", annotations / "instances.tsv")
        for name, outlines in DRAWN["polygons"].items():
            ids = rasterize(outlines, CAMERA["width"], CAMERA["height"])
            Image.fromarray(ids).save((annotations / name).with_suffix(".png"))


@command(__doc__)
@click.argument("pictures", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(pictures: Path) -> None:
    """Make the recording, and print the next command."""
    write_recording(pictures, Path("data/tum_office"))
    config = "benchmarks/real_pictures/config.yaml"
    click.echo(f"snakemake --cores 2 --configfile {config} -- results/tum/office/metrics.json")


if __name__ == "__main__":
    main()
