"""Read frames at the working size, at which H and the temporary Gaussians are trained."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.stored_rows import stored_rows
from egosplat.gaussians.training_views import Mask, Views
from egosplat.geometry import Camera


def working_size(height: int, width: int, resolution: int) -> tuple[int, int]:
    """Return height and width scaled down so that the longer side is at most ``resolution``."""
    factor = min(resolution / max(height, width), 1.0)
    return max(round(height * factor), 1), max(round(width * factor), 1)


def reduced(picture: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Downscale (h, w, 3) to (height, width, 3) by area averaging."""
    if picture.shape[:2] == (height, width):
        return picture
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def read_reduced_views(
    frames: Artifact, poses: Artifact, chosen: Mask, resolution: int, device: torch.device
) -> Views:
    """Read the frames ``chosen`` (F,) bool, all with a pose, at ``resolution``, as many as ``stored_rows`` holds in memory."""
    rows = np.flatnonzero(chosen)
    _, full_height, full_width, _ = frames.shape("rgb")
    height, width = working_size(full_height, full_width, resolution)
    pictures = stored_rows(
        len(rows),
        (height, width, 3),
        "uint8",
        lambda position: reduced(frames.row("rgb", rows[position]), height, width),
    )
    valid = frames.read("valid").astype(np.uint8) * 255
    # A pixel is valid only if every pixel averaged into it lies inside the lens circle.
    inside = torch.from_numpy(cv2.resize(valid, (width, height), interpolation=cv2.INTER_AREA) == 255)
    full = Camera.from_matrix(poses.read("intrinsics"), full_width, full_height)
    return Views(
        frame=rows.astype(np.int64),
        pictures=pictures,
        camera_to_world=poses.read("camera_to_world")[rows],
        valid=None if bool(inside.all()) else inside.to(device, torch.float32),
        transient=None,
        camera=full.scaled_to(width, height),
        device=device,
    )
