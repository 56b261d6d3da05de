"""Render a 3D thing in one view."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.gaussians.render import view_of
from egosplat.geometry import Array, Camera
from egosplat.query.answer import ask, filled_mask
from egosplat.query.maps import Map, Mask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene, rendering_camera
from egosplat.query.text import Texts
from egosplat.rasterize.view import composite


@dataclass(frozen=True, eq=False)
class ThingView:
    """A thing in a view of (H, W) pixels.

    Attributes:
        mask: (H, W) bool pixels that show the thing.
        pixel: column and row of the mask's pixel farthest from the mask's border; None if the mask is empty.
        relevancy: (H, W) float32 at the thing's level, for the whole view; 0 where no code is visible.
    """

    mask: Mask
    pixel: tuple[int, int] | None
    relevancy: Map


@torch.inference_mode()
def view_thing(
    scene: QueryScene,
    thing: NDArray[np.int64],
    level: int,
    texts: Texts,
    camera: Camera,
    camera_to_world: Array,
    valid: Mask | None,
    options: QueryOptions,
) -> ThingView:
    """Render a thing's mask and the relevancy of the whole view.

    Args:
        thing: (M,) indices of its Gaussians.
        level: index of its level.
        valid: (H, W) bool pixels that show the scene, or None for all.
        options: ``resolution``, ``min_coverage`` and ``temperature`` are used.
    """
    small = rendering_camera(camera, options.resolution)
    inside = np.ones((camera.height, camera.width), bool) if valid is None else valid
    # Rendered as a value of 1 among 0, so Gaussians in front of the thing hide it.
    members = torch.zeros(scene.gaussians.count, 1, device=scene.code.device)
    members[torch.from_numpy(thing).to(members.device)] = 1.0
    filled, _ = composite(view_of(scene.gaussians, small, camera_to_world, scene.settings), members)
    mask = filled_mask(filled[..., 0].cpu().numpy(), inside)
    kept = slice(level, level + 1)
    of_level = replace(scene, code=scene.code[:, kept], share=scene.share[:, kept])
    [answer] = ask(of_level, texts, camera, camera_to_world, valid, options)
    return ThingView(mask, _innermost(mask), answer.relevancy)


def _innermost(mask: Mask) -> tuple[int, int] | None:
    if not mask.any():
        return None
    # Padding counts the image border as a border of the mask: a marker drawn there would be cut off.
    distance = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, column = np.unravel_index(distance.argmax(), mask.shape)
    return int(column), int(row)
