"""Write the centers of Gaussians as a point cloud in the colors of their instances."""

from pathlib import Path

import numpy as np

from egosplat.artifacts.lineage import locate, open_histories
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, SPLATS, seconds_of
from egosplat.errors import UserError
from egosplat.export.ply import Columns, point_columns, write_ply
from egosplat.gaussians.io import read_gaussians
from egosplat.histories.known import Rests
from egosplat.progress import log
from egosplat.query.instances import instances_of_gaussians
from egosplat.report.sheets.from_above import palette

# Color of points without an instance.
_GREY = 96

# Gaussians that are less opaque show no surface.
LEAST_OPACITY = 0.5


def export_instances(scene: Path, output: Path) -> None:
    """Write a point for each Gaussian on a surface, with its instance at each level, -1 for none, and its color.

    Where histories.zarr is there, its things are points, too, and every point has a thing, -1 for what stays, and a span of time.

    Raises:
        UserError: an artifact is missing or damaged, or the instances are tracks.
    """
    splats, instances = map(open_artifact, locate(scene, "splats", "instances"), (SPLATS, INSTANCES))
    gaussians = read_gaussians(splats)
    on_surface = gaussians.opacities >= LEAST_OPACITY
    xyz = gaussians.select(on_surface).means.numpy()
    owner = instances_of_gaussians(instances, xyz)
    if owner is None:
        raise UserError(
            f"{scene}: its instances are tracks, which have no place in 3D; set instances.source to masks or both"
        )
    levels = instances.facts["levels"]
    colors = (palette(instances.shape("instances/level")[0]) * 255).round().astype(np.uint8)
    coarsest = owner[-1]
    rgb = np.where((coarsest >= 0)[:, None], colors[coarsest], np.uint8(_GREY))
    columns = point_columns(xyz, rgb)
    columns |= {f"instance_{level}": owner[index] for index, level in enumerate(levels)}
    told = f"{len(np.unique(coarsest[coarsest >= 0]))} instances of level {levels[-1]}"
    if (made := open_histories(scene, splats)) is not None:
        seconds = seconds_of(open_artifact(*locate(scene, "frames"), FRAMES))
        rests = Rests.read(made, seconds, gaussians.means.device)
        columns = _with_rests(columns, rests, float(seconds[-1]))
        told += f", {len(rests.thing)} rests"
    write_ply(output, columns, splats.origin)
    log(f"{output}: {len(columns['x'])} points, {told}")


def _with_rests(columns: Columns, rests: Rests, last_s: float) -> Columns:
    """Append the points of rests to those of what stays, which lasts until the last second."""
    shown = (rests.gaussians.opacities >= LEAST_OPACITY).numpy()
    rest, count = rests.rest[shown], len(columns["x"])
    thing = rests.thing[rest].astype(np.int32)
    colors = (palette(len(rests.feature)) * 255).round().astype(np.uint8)
    stays = {
        "thing": np.full(count, -1, np.int32),
        "from_s": np.zeros(count),
        "until_s": np.full(count, last_s),
    }
    lying = {"thing": thing, "from_s": rests.from_s[rest], "until_s": rests.until_s[rest]}
    lying |= point_columns(rests.gaussians.means.numpy()[shown], colors[thing])
    nothing = np.full(len(rest), -1, np.int32)
    return {
        name: np.concatenate([values, lying.get(name, nothing)]) for name, values in (columns | stays).items()
    }
