"""A thing of the scene as one view shows it."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch

from egosplat.codes.rendering import render_codes, render_values
from egosplat.geometry import Array, Camera
from egosplat.query.answer import rendering_camera
from egosplat.query.maps import Map, Mask
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.scene import QueryScene
from egosplat.query.text import Texts
from egosplat.query.things import Thing

HALF = 0.5
"""A pixel belongs to a thing where the thing's Gaussians make up more than this part of it."""


@dataclass(frozen=True, eq=False)
class ThingView:
    """A thing in a view of (H, W) pixels.

    Attributes:
        mask: (H, W) bool pixels that show it.
        pixel: column and row of the mask's pixel that is farthest from the mask's border; None of an empty mask.
        relevancy: (H, W) float32 relevancy of all that is seen, at the thing's level; 0 where nothing is seen.
    """

    mask: Mask
    pixel: tuple[int, int] | None
    relevancy: Map


@torch.inference_mode()
def view_thing(
    scene: QueryScene,
    thing: Thing,
    texts: Texts,
    camera: Camera,
    camera_to_world: Array,
    valid: Mask | None,
    options: QueryOptions,
) -> ThingView:
    """Render a thing and the relevancy around it.

    Args:
        scene: that it was found in.
        thing: what is rendered.
        texts: the one query that found it.
        camera, camera_to_world: of the view.
        valid: (H, W) bool pixels that show the scene, or None for all.
        options: ``resolution``, ``min_coverage`` and ``temperature`` are used.
    """
    size = camera.width, camera.height
    small = rendering_camera(camera, options.resolution)
    inside = np.ones(size[::-1], bool) if valid is None else valid
    members = torch.zeros(scene.gaussians.count, 1, device=scene.code.device)
    members[torch.from_numpy(thing.members).to(members.device)] = 1.0
    filled, _ = render_values(scene.gaussians, members, small, camera_to_world, scene.settings)
    mask = (cv2.resize(filled[..., 0].cpu().numpy(), size) > HALF) & inside
    at = slice(thing.level, thing.level + 1)
    codes = render_codes(
        scene.gaussians,
        scene.code[:, at],
        scene.share[:, at],
        small,
        camera_to_world,
        scene.settings,
    )
    seen = codes.coverage > options.min_coverage
    fits = relevancy_maps(codes.codes, seen, scene.decoder, texts, options.temperature)[0, 0]
    relevancy = np.where(inside, cv2.resize(fits.cpu().numpy(), size), np.float32(0.0))
    return ThingView(mask, _innermost(mask), relevancy)


def _innermost(mask: Mask) -> tuple[int, int] | None:
    if not mask.any():
        return None
    # The picture's own border cuts a thing off and is no border of it, but a mark there would be cut as well.
    distance = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, column = np.unravel_index(distance.argmax(), mask.shape)
    return int(column), int(row)
