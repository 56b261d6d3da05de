"""Masks of a finished scene whose Gaussians are divided into any number of cells.

    python -m benchmarks.growth.masks SCENE FOLDER CELLS

A pixel belongs to the cell whose center is nearest to the surface that it shows. FOLDER gets segments.zarr, and links to what SCENE has of
the stages before.
"""

from pathlib import Path

import click
import numpy as np
from scipy.spatial import KDTree

from benchmarks.common import command
from benchmarks.long_recording.__main__ import created
from egosplat.artifacts.reader import open_any
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.render import view_of
from egosplat.geometry import Camera
from egosplat.rasterize.view import composite
from egosplat.segments.options import LEVELS


@command(__doc__)
@click.argument("scene", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.argument("cells", type=int)
def main(scene: Path, folder: Path, cells: int) -> None:
    """Write the masks."""
    folder.mkdir(exist_ok=True)
    for name in ("frames", "annotations", "poses", "transient"):
        if not (link := folder / f"{name}.zarr").is_symlink():
            link.symlink_to(scene / f"{name}.zarr")
    frames, poses, splats = (
        open_any(scene / f"{name}.zarr", SCHEMAS) for name in ("frames", "poses", "splats")
    )
    gaussians, settings = read_gaussians(splats), read_render_settings(splats, "auto")
    chosen = np.random.default_rng(0).choice(gaussians.count, cells, replace=False)
    centers, camera = KDTree(gaussians.means[chosen].numpy()), Camera(**frames.facts["camera"])
    valid, first = frames.read("valid"), [0]
    with created(folder, SCHEMAS["segments"], "frames") as artifact:
        artifact.allocate("labels", (frames.shape("rgb")[0], len(LEVELS), *valid.shape))
        for frame, pose in enumerate(poses.read("camera_to_world")):
            sums, opacity = composite(view_of(gaussians, camera, pose, settings), gaussians.means)
            _, cell = centers.query((sums / opacity.clamp(min=1e-6)[..., None]).numpy())
            shown = valid & (opacity.numpy() > 0.5)
            labels = np.full((len(LEVELS), *valid.shape), -1, np.int32)
            labels[-1][shown] = first[-1] + np.unique(cell[shown], return_inverse=True)[1]
            first.append(max(first[-1], int(labels.max()) + 1))
            artifact.put_row("labels", frame, labels)
        artifact.put("instances/level", np.full(first[-1], len(LEVELS) - 1, np.int8))
        artifact.put("instances/first_frame", np.repeat(np.arange(len(first) - 1), np.diff(first)))
        artifact.put("instances/moving", np.zeros(first[-1], bool))
        for name in ("predicted_iou", "stability"):
            artifact.put(f"instances/{name}", np.ones(first[-1], np.float32))
        by_level = dict.fromkeys(LEVELS, 0) | {LEVELS[-1]: first[-1]}
        artifact.facts = {"levels": list(LEVELS), "instances": by_level, "single_frames": True}


if __name__ == "__main__":
    main()
