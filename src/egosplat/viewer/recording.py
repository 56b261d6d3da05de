"""The frames of a recording in the viewer: photographs with what moves, and cameras as frusta."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.artifacts.frames import lies_on_its_side
from egosplat.geometry import Array
from egosplat.images import evenly_spaced, shrink_image
from egosplat.viewer.scene import ViewedScene

if TYPE_CHECKING:
    from viser import CameraFrustumHandle, ClientHandle

# Longer side of a photograph in the panel, and of a camera's picture [px].
PHOTOGRAPH_SIDE, THUMBNAIL_SIDE = 384, 64

# Maximum number of cameras, evenly spaced among the frames with a pose.
MOST_CAMERAS = 60

# Length of a frustum, relative to the reach of the scene.
FRUSTUM = 0.03

# Distance below which a frustum is hidden, in lengths of a frustum.
NEAR = 6.0

# Color of what moves, and its share in a pixel.
MOVING, SHARE = np.array([255.0, 40.0, 160.0]), 0.6


def photograph(viewed: ViewedScene, frame: int, tint: bool) -> NDArray[np.uint8]:
    """A frame, upright and small.

    Args:
        tint: whether what moves is tinted, by masks.zarr.

    Returns:
        (h, w, 3) uint8 sRGB.
    """
    picture = viewed.frames.row("rgb", frame)
    if tint and viewed.masks is not None:
        masked = viewed.masks.row("refined", frame)
        mixed = (1 - SHARE) * picture + SHARE * MOVING
        picture = np.where(masked[..., None], mixed, picture).astype(np.uint8)
    if lies_on_its_side(viewed.frames):
        picture = np.rot90(picture, -1)
    return shrink_image(np.ascontiguousarray(picture), PHOTOGRAPH_SIDE)


def add_cameras(
    client: "ClientHandle", viewed: ViewedScene, pictures: bool
) -> dict[int, "CameraFrustumHandle"]:
    """Draw cameras of the frames as frusta in a window; by frame."""
    camera, registered = viewed.trained.camera, viewed.registered
    made = {}
    for frame in map(int, registered[evenly_spaced(len(registered), MOST_CAMERAS)]):
        pose = viewed.camera_to_world[frame]
        made[frame] = client.scene.add_camera_frustum(
            f"/cameras/{frame}",
            fov=2 * math.atan(camera.height / 2 / camera.fy),
            aspect=camera.width / camera.height,
            scale=FRUSTUM * viewed.reach,
            thickness=1.0,
            thickness_units="screen",
            color=(255, 190, 60),
            image=shrink_image(viewed.frames.row("rgb", frame), THUMBNAIL_SIDE) if pictures else None,
            format="jpeg",
            wxyz=Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True),
            position=pose[:3, 3],
        )
    return made


def hide_near(cameras: Mapping[int, "CameraFrustumHandle"], viewed: ViewedScene, position: Array) -> None:
    """Hide the frusta around a place: whoever stands among them would see nothing else."""
    for frame, camera in cameras.items():
        distance = np.linalg.norm(viewed.camera_to_world[frame][:3, 3] - position)
        camera.visible = bool(distance > NEAR * FRUSTUM * viewed.reach)
