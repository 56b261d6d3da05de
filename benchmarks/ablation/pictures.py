"""The paper's figure 1 and its supplement's figure of transient things, of a scene on which something moves.

    snakemake --cores 2 --configfile benchmarks/ablation/pictures.yaml -- \\
        results/adt/busy1/{,variants/{no_masks,network_masks,langsplat}/}metrics.json
    python -m benchmarks.ablation.pictures results/adt/busy1 --output benchmarks/ablation

features.webp: what LangSplat and EgoSplat train with, and what their Gaussians render, on the training frames with most that moves.
transient.webp: held-out frames, rendered after training on all pixels, on those that the network leaves, and that refined masks leave.
Features of both are decoded and share their colors, principal components.
"""

from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.common import command
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS, camera_poses
from egosplat.drawing import hide_axes, plt
from egosplat.gaussians.render import view_of
from egosplat.images import encode_webp
from egosplat.language.decoder import decode
from egosplat.pipeline.variants import variant_folder
from egosplat.query.scene import read_scene
from egosplat.rasterize.view import render_codes

# Frames of a picture, width of a cell [inches], and quality of the file.
FRAMES_SHOWN, CELL, QUALITY = 3, 1.5, 80
VANILLA, INITIAL, LANGSPLAT = "no_masks", "network_masks", "langsplat"

Picture = NDArray[np.floating] | NDArray[np.uint8]
Colors = Callable[[NDArray[np.float32]], Picture]


class Method:
    """The artifacts of a scene's variant, its own or shared."""

    def __init__(self, folder: Path, variant: str | None) -> None:
        """Read its Gaussians."""
        self._folder = folder / variant_folder(variant)
        self.splats, self.features = self.open("splats"), self.open("features")
        self.camera_to_world = camera_poses(self.open("poses"), self.splats)
        self.scene = read_scene(self.splats, self.open("language"), self.features, "auto")

    def open(self, name: str) -> Artifact:
        """One of its artifacts."""
        (path,) = locate(self._folder, name)
        return open_artifact(path, SCHEMAS[name])

    def target(self, frame: int) -> NDArray[np.float32]:
        """(H, W, D) feature that each pixel is trained with at the largest level; 0 for none."""
        labels = self.open("instances").row("labels", frame)[-1]
        rows = np.flatnonzero(self.features.read("frame") == frame)
        features = np.zeros(
            (self.features.shape("consistent")[0] + 1, self.features.shape("supervision")[1]), np.float32
        )
        features[self.features.read("instance")[rows]] = self.features.read("supervision")[rows]
        return features[labels]

    @torch.no_grad()
    def rendered(self, frame: int) -> NDArray[np.float32]:
        """(H, W, D) decoded feature of each pixel at the largest level; 0 where no code is."""
        scene, pose = self.scene, self.camera_to_world[frame]
        view = view_of(scene.gaussians, scene.camera, pose, scene.settings)
        codes, coverage = render_codes(view, scene.code, scene.share)
        return (decode(codes[-1], scene.decoder) * (coverage[-1, ..., None] > 0.01)).cpu().numpy()

    def picture(self, frame: int) -> Picture:
        """Its render."""
        return self.scene.picture(self.scene.camera, self.camera_to_world[frame])


def colors_of(features: NDArray[np.float32]) -> Colors:
    """Colors of features by the three principal components of (N, D) others, gray for 0."""
    mean = features.mean(axis=0)
    scale, directions = np.linalg.svd(features - mean, full_matrices=False)[1:]
    spread = 2 * scale[:3] / np.sqrt(len(features))
    signs = np.sign(directions[np.arange(3), np.abs(directions[:3]).argmax(axis=1)])
    axes = directions[:3].T * signs / (2 * spread)
    return lambda values: np.where(
        values.any(axis=-1, keepdims=True), np.clip(0.5 + (values - mean) @ axes, 0, 1), 0.25
    )


def most_masked(masks: Artifact, rows: NDArray[np.int64]) -> list[int]:
    """The frame with the most masked pixels of each part of the recording."""
    share = np.array([masks.row("refined", int(row)).mean() for row in rows])
    parts = np.array_split(np.arange(len(rows)), FRAMES_SHOWN)
    return [int(rows[part[share[part].argmax()]]) for part in parts]


def draw(rows: list[dict[str, Picture]], output: Path) -> None:
    """Draw rows of pictures with their titles as WebP."""
    size = (CELL * len(rows[0]), CELL * len(rows) + 0.25)
    figure, grid = plt.subplots(len(rows), len(rows[0]), squeeze=False, figsize=size, dpi=110)
    for cells, row in zip(grid, rows, strict=True):
        for cell, (title, picture) in zip(cells, row.items(), strict=True):
            hide_axes(cell)
            cell.imshow(picture, cmap="inferno", vmin=0, vmax=1)
            if row is rows[0]:
                cell.set_title(title, fontsize=7)
    figure.subplots_adjust(0, 0, 1, 1 - 0.2 / size[1], 0.02, 0.02)
    figure.canvas.draw()
    output.write_bytes(encode_webp(np.asarray(figure.canvas.buffer_rgba())[..., :3], QUALITY).tobytes())
    plt.close(figure)


@command(__doc__)
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
@click.option("--output", type=click.Path(path_type=Path), required=True, help="Folder of the pictures.")
def main(folder: Path, output: Path) -> None:
    """Draw both pictures."""
    vanilla, initial, langsplat, own = (Method(folder, one) for one in (VANILLA, INITIAL, LANGSPLAT, None))
    frames, masks, transient = own.open("frames"), own.open("masks"), own.open("transient")
    trained = np.unique(own.features.read("frame"))
    colors = colors_of(own.features.read("supervision"))
    rows: list[dict[str, Picture]] = []
    for frame in most_masked(masks, np.intersect1d(trained, langsplat.features.read("frame"))):
        row: dict[str, Picture] = {"photograph": frames.row("rgb", frame)}
        for name, method in (("LangSplat", langsplat), ("EgoSplat", own)):
            row[f"{name}: trained with"] = colors(method.target(frame))
            row[f"{name}: rendered"] = colors(method.rendered(frame))
        rows.append(row)
    draw(rows, output / "features.webp")
    rows = []
    for frame in most_masked(masks, np.flatnonzero(frames.read("evaluation"))):
        row = {"photograph": frames.row("rgb", frame)}
        row |= {"3DGS": vanilla.picture(frame), "its features": colors(vanilla.rendered(frame))}
        row["the network's map"] = transient.row("probability", frame).astype(np.float32)
        row |= {"with it": initial.picture(frame), "features with it": colors(initial.rendered(frame))}
        row["refined mask"] = masks.row("refined", frame).astype(np.float32)
        row |= {"with this": own.picture(frame), "features with this": colors(own.rendered(frame))}
        rows.append(row)
    draw(rows, output / "transient.webp")


if __name__ == "__main__":
    main()
