"""Send pictures to a browser window: small ones while its camera moves, a large one when it rests."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.geometry import Array, Camera, make_pose
from egosplat.viewer.pictures import browser_camera

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle

# Longer side of a picture [px] while the camera moves, and largest one at rest.
MOVING_SIDE, RESTING_SIDE = 288, 1024

# Time without a movement after which the camera rests [s].
REST_S = 0.25

# JPEG quality of the pictures, 0..100.
MOVING_QUALITY, RESTING_QUALITY = 70, 88

Draw = Callable[[Camera, Array], tuple[NDArray[np.uint8], NDArray[np.float32]] | None]


class Renderer(threading.Thread):
    """Draws for one window until it is stopped."""

    def __init__(self, client: "ClientHandle", draw: Draw) -> None:
        """Prepare a thread.

        Args:
            draw: draws the view of a camera with a pose; returns colors and depth, or None for no picture.
        """
        super().__init__(daemon=True, name=f"renderer {client.client_id}")
        self._client, self._draw = client, draw
        self._wanted, self._moved = threading.Event(), threading.Event()
        self._stopped = False

    def camera_moved(self) -> None:
        """Draw soon: small at first."""
        self._moved.set()
        self._wanted.set()

    def changed(self) -> None:
        """Draw soon, at full size: the colors changed."""
        self._wanted.set()

    def stop(self) -> None:
        """End the thread after the current picture."""
        self._stopped = True
        self._wanted.set()

    def run(self) -> None:
        """Draw when something changed."""
        while True:
            self._wanted.wait()
            self._wanted.clear()
            if self._stopped:
                return
            if self._moved.is_set():
                self._moved.clear()
                self._send(MOVING_SIDE, MOVING_QUALITY)
                if self._wanted.wait(REST_S):
                    continue
            self._send(RESTING_SIDE, RESTING_QUALITY)

    def _send(self, longest: int, quality: int) -> None:
        camera, pose = view_of_window(self._client.camera, longest)
        drawn = self._draw(camera, pose)
        if drawn is None or self._stopped:
            return
        image, depth = drawn
        self._client.scene.set_background_image(image, format="jpeg", jpeg_quality=quality, depth=depth)
        self._client.flush()


def view_of_window(handle: "CameraHandle", longest: int) -> tuple[Camera, Array]:
    """The camera of a window and its (4, 4) pose.

    Args:
        longest: largest side of the picture [px]; a smaller window gets a picture of its own size.
    """
    width, height = max(1, handle.image_width), max(1, handle.image_height)
    scale = min(1.0, longest / max(width, height))
    camera = browser_camera(handle.fov, max(1, round(width * scale)), max(1, round(height * scale)))
    # viser's axes of a camera are OpenCV's, too; its quaternion is wxyz.
    rotation = Rotation.from_quat(handle.wxyz, scalar_first=True).as_matrix()
    return camera, make_pose(rotation, np.array(handle.position))
