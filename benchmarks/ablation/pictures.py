"""Pictures of components: the network's masks against the refined ones, and codes of variants side by side.

    python -m benchmarks.ablation.pictures masks results/adt/busy1 --output masks.png
    python -m benchmarks.ablation.pictures codes results/adt/busy1 frame_masks langsplat --output codes.png

The scene needs its variants: network_masks for the masks, those named for the codes. Frames are held out of the training.
"""

from pathlib import Path

import click
import numpy as np
import torch
from matplotlib.axes import Axes
from numpy.typing import NDArray

from benchmarks.common import command
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, LANGUAGE, MASKS, POSES, SPLATS, TRANSIENT, camera_poses
from egosplat.drawing import middles_of_parts, plt, save_figure, show
from egosplat.language.rendering import render_codes
from egosplat.pipeline.variants import variant_folder
from egosplat.query.scene import TrainedScene, read_trained_scene
from egosplat.report.sheets.language_sheet import blend, code_colors

# Number of frames, and width of an image [inches].
ROWS, CELL = 4, 2.6


def trained(folder: Path, variant: str | None) -> tuple[Artifact, TrainedScene]:
    """The Gaussians of a scene or variant."""
    (path,) = locate(folder / variant_folder(variant), "splats")
    splats = open_artifact(path, SPLATS)
    return splats, read_trained_scene(splats, "auto")


def most_masked(frames: Artifact, masks: Artifact) -> list[int]:
    """Held-out frames with the most masked pixels, in order of time; a part of the recording gives one."""
    held_out = np.flatnonzero(frames.read("evaluation"))
    share = np.array([masks.row("refined", int(frame)).mean() for frame in held_out])
    parts = np.array_split(np.arange(len(held_out)), min(ROWS, len(held_out)))
    return [int(held_out[part[np.argmax(share[part])]]) for part in parts]


def tinted(photograph: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A photograph with masked pixels in red."""
    red = np.array([220, 20, 60])
    return np.where(mask[..., None], 0.5 * photograph + 0.5 * red, photograph).astype(np.uint8)


def draw_masks(folder: Path) -> list[list[tuple[NDArray, str]]]:
    """Cells of each frame: photograph, network's map, render trained with it, refined mask, render trained with it."""
    frames, poses = (open_artifact(folder / f"{schema.name}.zarr", schema) for schema in (FRAMES, POSES))
    masks, transient = (
        open_artifact(folder / f"{schema.name}.zarr", schema) for schema in (MASKS, TRANSIENT)
    )
    scenes = [trained(folder, variant) for variant in ("network_masks", None)]
    rows = []
    for frame in most_masked(frames, masks):
        photograph = frames.row("rgb", frame)
        renders = [
            scene.picture(scene.camera, camera_poses(poses, splats)[frame]) for splats, scene in scenes
        ]
        refined = masks.row("refined", frame)
        rows.append(
            [
                (photograph, f"frame {frame}"),
                (transient.row("probability", frame).astype(np.float32), "the network's map"),
                (renders[0], "trained with it"),
                (tinted(photograph, refined), f"refined: {refined.mean():.1%}"),
                (renders[1], "trained with it"),
            ]
        )
    return rows


@torch.no_grad()
def code_picture(folder: Path, variant: str | None, poses: Artifact, frame: int) -> NDArray[np.float64]:
    """The codes of the largest level as colors, each variant with principal colors of its own."""
    splats, scene = trained(folder, variant)
    language = open_artifact(*locate(folder / variant_folder(variant), "language"), LANGUAGE)
    code, share = language.read("code"), language.read("share")
    colors = code_colors(code, share)
    on_device = (torch.from_numpy(part).to(scene.gaussians.means.device) for part in (colors, share))
    pose = camera_poses(poses, splats)[frame]
    found = render_codes(scene.gaussians, *on_device, scene.camera, pose, scene.settings)
    return blend(*(values[-1].cpu().numpy() for values in found))


def draw_codes(folder: Path, variants: tuple[str, ...]) -> list[list[tuple[NDArray, str]]]:
    """Cells of each frame: photograph, codes of each variant, codes of the scene."""
    frames, poses = (open_artifact(folder / f"{schema.name}.zarr", schema) for schema in (FRAMES, POSES))
    held_out = np.flatnonzero(frames.read("evaluation"))
    shown = [int(held_out[one]) for one in middles_of_parts(len(held_out), ROWS)]
    return [
        [
            (frames.row("rgb", frame), f"frame {frame}"),
            *((code_picture(folder, one, poses, frame), one or "EgoSplat") for one in (*variants, None)),
        ]
        for frame in shown
    ]


@command(__doc__)
@click.argument("what", type=click.Choice(["masks", "codes"]))
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
@click.argument("variants", nargs=-1)
@click.option("--output", type=click.Path(path_type=Path), required=True)
def main(what: str, folder: Path, variants: tuple[str, ...], output: Path) -> None:
    """Draw the picture."""
    rows = draw_masks(folder) if what == "masks" else draw_codes(folder, variants)
    columns = len(rows[0])
    figure, grid = plt.subplots(
        len(rows),
        columns,
        squeeze=False,
        figsize=(CELL * columns, (CELL + 0.2) * len(rows)),
        layout="constrained",
    )
    for cells, row in zip(grid, rows, strict=True):
        draw_row(cells, row)
    save_figure(figure, output)


def draw_row(cells: NDArray[np.object_], row: list[tuple[NDArray, str]]) -> None:
    """Draw the pictures of a frame beside each other."""
    cell: Axes
    for cell, (picture, title) in zip(cells, row, strict=True):
        cell.set_axis_off()
        style = {"cmap": "inferno", "vmin": 0.0, "vmax": 1.0} if picture.ndim == 2 else {}
        show(cell, picture, title, **style)


if __name__ == "__main__":
    main()
