"""Poses of a plain recording that are known already, from a COLMAP model or a ``transforms.json``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import known_poses_path
from egosplat.calibration.known_poses import read_known_poses
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import MAX_ERROR_PX, MIN_TRACK_LENGTH, Poses, find_parallax, mean_camera_up
from egosplat.progress import format_ranges, log


def known_poses(recording: Path, facts: Mapping[str, Any], options: PosesOptions) -> Poses:
    """Take the poses of a recording's frames from its file, as they are, and in meters if their scale is
    given. ``facts`` are those of the frames. Points as for ``colmap_poses``; all of a file without views.
    UserError if the file is damaged or has changed since the frames were read, or too few frames have a
    pose."""
    kind, lenses = facts["known_poses"], [Lens.of_facts(lens) for lens in facts["lenses"]]
    camera, pinhole = Camera(**facts["camera"]), Camera(**facts["pinhole"])
    path = known_poses_path(recording, kind)
    known = read_known_poses(recording, kind, lenses[0].width, lenses[0].height)
    # By all pictures: of fewer ones, a name may be the end of another's.
    row = np.array(facts["entry_of_frame"])
    if known.lenses != lenses or row.max() >= len(known.names):
        raise UserError(f"{path}: has changed since the frames were read. Rebuild frames.zarr.")
    registered = row >= 0
    _check_share(registered, path, options.min_registered)
    scale = options.meters_per_unit or 1.0
    camera_to_world = np.full((len(row), 4, 4), np.nan)
    camera_to_world[registered] = known.camera_to_world[row[registered]]
    camera_to_world[registered, :3, 3] *= scale
    finite = np.isfinite(known.points).all(axis=1)
    if not finite.all():
        log(f"{path}: leaves out {(~finite).sum()} of {len(known.points)} points, which are not finite")
    # Errors in pixels of the frames. A file without views says nothing about its points' depths.
    near = known.point_error_px * (camera.width / pinhole.width) <= MAX_ERROR_PX
    kept = finite & near & ((known.point_views >= MIN_TRACK_LENGTH) | ~known.point_views.any())
    points, up = known.points[kept] * scale, mean_camera_up(camera_to_world[registered])
    looks, centers = camera_to_world[registered, :3, 2:].transpose(2, 0, 1)
    some = points[:: len(points) // 2000 + 1]
    if len(some) and (some @ looks.T > (looks * centers).sum(axis=1)).any(axis=1).mean() < 0.5:
        # As of poses in other axes, which the triangulation of other points tells.
        log(f"{path}: leaves out its points, most of which lie behind every camera")
        points, kept = points[:0], []
    notes = {
        "source": "known",
        "file": str(path.relative_to(recording.parent)),
        "scale": "arbitrary" if options.meters_per_unit is None else "meters",
        "parallax_deg": find_parallax(camera_to_world[registered, :3, 3], points),
        **known.notes,
    }
    arbitrary = "a scene unit (poses.meters_per_unit makes it meters)"
    unit = f"{scale:g} m" if options.meters_per_unit else arbitrary
    log(f"poses as in {path}; one unit of the file is {unit}")
    return Poses(camera_to_world, camera, points, known.point_rgb[kept], up, notes)


def _check_share(registered: NDArray[np.bool_], path: Path, wanted: float) -> None:
    """Log the frames without a pose, or raise UserError if they are too many."""
    without = format_ranges(set(np.flatnonzero(~registered).tolist()))
    if registered.sum() < wanted * len(registered):
        raise UserError(
            f"{path}: has poses of {registered.sum()} of {len(registered)} frames, and poses.min_registered requires "
            f"{wanted:.0%}; without a pose (indices from 0): {without}\n"
            "Add them, leave these frames out, or accept the loss by poses.min_registered"
        )
    if without:
        log(f"{path}: has no pose of the frames {without} (indices from 0); they are not used")
