"""PSNR of presets at one picture size: held-out renders and photographs of each, averaged to the smallest preset's pixels.

    python -m benchmarks.tradeoff.one_size ledger/0.2.0-COMMIT/results/ledger/apartment* --variants draft

Presets read pictures of different sizes, and a smaller picture has less detail to miss: their own PSNR is not comparable.
"""

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
import torch

from benchmarks.common import command, markdown, scene_folders
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SCHEMAS, shown_pixels
from egosplat.evaluation.evaluation_frames import Evaluation, read_evaluation, regions
from egosplat.image_quality import psnr
from egosplat.images import resize_image
from egosplat.pipeline.variants import variant_folder


def evaluation_of(folder: Path) -> Evaluation:
    """The evaluation frames of a scene or variant."""
    frames, poses, splats = locate(folder, "frames", "poses", "splats")
    # A variant that reads the scene's frames has the scene's annotations.
    paths = {
        "frames": frames,
        "poses": poses,
        "annotations": frames.with_name("annotations.zarr"),
        "splats": splats,
    }
    return read_evaluation(*(open_artifact(path, SCHEMAS[name]) for name, path in paths.items()))


def mean_psnr(one: Evaluation, smallest: Evaluation) -> float:
    """Mean PSNR [dB] of the static pixels of the held-out frames, at the size and in the regions of ``smallest``."""
    size, found = (smallest.camera.width, smallest.camera.height), []
    for frame, place in zip(one.frames, smallest.frames, strict=True):
        if frame.held_out is None or not place.annotated:
            continue
        shown = shown_pixels(smallest.frames_artifact, place.index, smallest.valid)
        static = regions(smallest.map_of(place), smallest.instances, shown)["static"]
        pictures = (
            one.splats.row("held_out/render", frame.held_out),
            one.frames_artifact.row("rgb", frame.index),
        )
        render, photograph = (torch.from_numpy(resize_image(picture, *size)) for picture in pictures)
        found.append(psnr(render, photograph, torch.from_numpy(static)))
    return float(np.mean(found))


def rows_of(folder: Path, variants: Sequence[str]) -> list[float]:
    """The PSNR of a scene and of its variants, at the size of the smallest [dB]."""
    every = [evaluation_of(folder / variant_folder(name)) for name in (None, *variants)]
    smallest = min(every, key=lambda one: one.camera.width)
    return [mean_psnr(one, smallest) for one in every]


@command(__doc__)
@scene_folders
@click.option("--variants", required=True, help="Comma-separated names of variants.")
def main(folders: tuple[Path, ...], variants: str) -> None:
    """Print the table."""
    names = variants.split(",")
    found = np.array([rows_of(folder, names) for folder in folders])
    rows = [
        [name, f"{own.mean():.2f}", f"{own.min():.2f} to {own.max():.2f}"]
        for name, own in zip(("the scene", *names), found.T, strict=True)
    ]
    click.echo(markdown(("preset", "static PSNR at one size [dB]", "scenes"), rows))


if __name__ == "__main__":
    main()
