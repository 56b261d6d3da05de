"""Write the centers of Gaussians as a point cloud in the colors of their instances."""

from pathlib import Path

import numpy as np

from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.errors import UserError
from egosplat.export.ply import point_columns, write_ply
from egosplat.gaussians.io import read_gaussians
from egosplat.progress import log
from egosplat.query.instances import instances_of_gaussians
from egosplat.report.sheets.from_above import palette

# Color of points without an instance.
_GREY = 96

# Gaussians that are less opaque show no surface.
LEAST_OPACITY = 0.5


def export_instances(scene: Path, output: Path) -> None:
    """Write a point for each Gaussian on a surface, with its instance at each level, -1 for none, and its color.

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
    write_ply(output, columns, splats.origin)
    log(
        f"{output}: {len(xyz)} points, {len(np.unique(coarsest[coarsest >= 0]))} instances of level {levels[-1]}"
    )
