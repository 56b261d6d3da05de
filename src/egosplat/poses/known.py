"""Poses of a plain recording that are known already, from a COLMAP model or a ``transforms.json``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.calibration.contents import Contents
from egosplat.calibration.files import accept_advice, known_poses_path
from egosplat.calibration.gsplat_world import gsplat_world
from egosplat.calibration.known_poses import match_pictures, read_known_poses
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import (
    MAX_REPROJECTION_ERROR_PX,
    MIN_TRACK_LENGTH,
    Poses,
    find_parallax,
    mean_camera_up,
    unregistered,
)
from egosplat.progress import format_ranges, log


def known_poses(
    recording: Path,
    kind: str,
    lenses: list[Lens],
    pinhole: Camera,
    pictures: Sequence[str],
    camera: Camera,
    options: PosesOptions,
) -> Poses:
    """Take the poses of a recording's frames from its file, as they are.

    Args:
        kind: of the file, a key of ``KNOWN_POSES``.
        lenses, pinhole: that the full-size pictures were rectified from and to.
        pictures: name of each frame's picture.
        camera: of the frames.

    Returns:
        Poses in the file's world, in meters if their scale is given. Points as for ``colmap_poses``; all of a file without views.

    Raises:
        UserError: the file is damaged or has changed since the frames were read, or too few frames have a pose.
    """
    path = known_poses_path(recording, kind)
    contents = read_known_poses(recording, kind, lenses[0].width, lenses[0].height)
    if contents.lenses != lenses:
        raise UserError(f"{path}: has changed since the frames were read. Rebuild frames.zarr.")
    row, _ = match_pictures(contents.names, pictures, path)
    registered = row >= 0
    _check_share(registered, path, options.min_registered)
    scale = options.meters_per_unit or 1.0
    camera_to_world = unregistered(len(pictures))
    camera_to_world[registered] = contents.camera_to_world[row[registered]]
    camera_to_world[registered, :3, 3] *= scale
    kept = _kept_points(contents, camera.width / pinhole.width)
    if lost := int((~np.isfinite(contents.points).all(axis=1)).sum()):
        log(f"{path}: leaves out {lost} of {len(contents.points)} points, which are not finite")
    notes = {
        "source": "known",
        "file": str(path.relative_to(recording.parent)),
        "frames": len(pictures),
        "registered": int(registered.sum()),
        "points": int(kept.sum()),
        "points_read": len(kept),
        "scale": "arbitrary" if options.meters_per_unit is None else "meters",
        "parallax_deg": find_parallax(camera_to_world[registered, :3, 3], contents.points[kept] * scale),
        **contents.notes,
    }
    log(_summary(path, notes, options.meters_per_unit))
    gsplat = gsplat_world(contents.camera_to_world, contents.points) if kind == "colmap" else None
    if gsplat is not None:
        notes["gsplat_world"] = gsplat.tolist()
    up, points = mean_camera_up(camera_to_world[registered]), contents.points[kept] * scale
    return Poses(camera_to_world, registered, camera, points, contents.point_rgb[kept], up, notes).check()


def _check_share(registered: np.ndarray, path: Path, min_registered: float) -> None:
    frames, count = len(registered), int(registered.sum())
    without = format_ranges(set(np.flatnonzero(~registered).tolist()))
    if count < min_registered * frames:
        ways = ["Add them", "leave these frames out", accept_advice(count, frames)]
        advice = ", or ".join(filter(None, ways))
        raise UserError(
            f"{path}: has poses of {count} of {frames} frames, and poses.min_registered requires {min_registered:.0%}; "
            f"without a pose (indices from 0): {without}\n{advice}"
        )
    if without:
        log(f"{path}: has no pose of the frames {without} (indices from 0); they are not used")


def _kept_points(contents: Contents, pixel_scale: float) -> np.ndarray:
    """(P,) bool: the points that ``colmap_poses`` would keep, with errors in pixels of the frames."""
    views, error = contents.point_views, contents.point_error_px * pixel_scale
    # A file without views says nothing about its points' depths.
    seen = views >= MIN_TRACK_LENGTH if views.any() else np.ones(len(views), bool)
    return seen & (error <= MAX_REPROJECTION_ERROR_PX) & np.isfinite(contents.points).all(axis=1)


def _summary(path: Path, notes: dict[str, Any], meters_per_unit: float | None) -> str:
    """The log line that names the world of the poses."""
    unit = "lengths are in scene units (poses.meters_per_unit makes them meters)"
    unit = unit if meters_per_unit is None else f"one unit of the file is {meters_per_unit:g} m"
    turned = ", turned by its applied_transform" if "applied_transform" in notes else ""
    scaled = f", scaled by its applied_scale {notes['applied_scale']:g}" if "applied_scale" in notes else ""
    return f"poses as in {path}{turned}{scaled}; {unit}"
