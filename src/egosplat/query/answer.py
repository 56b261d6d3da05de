"""Answers to queries in one view: its codes are rendered, compared with the queries, and read as maps."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.codes.decoder import Decoder
from egosplat.codes.rendering import render_codes
from egosplat.gaussians.render import render
from egosplat.geometry import Array, Camera, transform
from egosplat.query.maps import Found, Map, Mask, find_in_maps
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.scene import QueryScene
from egosplat.query.text import Texts

_MAPS_AT_ONCE = 2**27
"""Numbers of relevancy that are held at a time, 512 MiB in float32; more queries are decoded for in turn."""


@dataclass(frozen=True, eq=False)
class View:
    """One view of the codes, at the resolution (h, w) in which they were rendered.

    Attributes:
        codes: (L, h, w, C) float32 codes of full weight at each level.
        coverage: (L, h, w) float32 in 0..1: how much of a pixel is covered by something with a code.
        depth: (h, w) float32 expected camera z [m]; 0 where nothing is.
        camera: of the picture of the answers, (H, W); its image is the codes', resized.
        camera_to_world: (4, 4) float64.
        valid: (H, W) bool pixels of the picture that show the scene, or None for all; there is no answer elsewhere.
    """

    codes: Tensor
    coverage: Tensor
    depth: Tensor
    camera: Camera
    camera_to_world: Array
    valid: Mask | None


@dataclass(frozen=True, eq=False)
class Answer:
    """What one query finds in one view of (H, W) pixels.

    Where nothing is seen at any level there is no answer: score 0, no candidates, an empty mask, and None.

    Attributes:
        phrase: the query's words.
        score: largest smoothed relevancy, 0..1; above 0.5 it fits better than every canonical phrase.
        level: index of the level that this is found at.
        candidates: (K, 2) int64 column and row of all pixels that have it.
        pixel: column and row of the one among them that is nearest to their middle.
        position: (3,) float64 place in the world that this pixel's centre shows [m]; None also without depth.
        relevancy: (H, W) float32 at ``level``, not smoothed; 0 where nothing is seen.
        mask_level: index of the level that the mask is made at.
        mask: (H, W) bool.
    """

    phrase: str
    score: float
    level: int | None
    candidates: NDArray[np.int64]
    pixel: tuple[int, int] | None
    position: Array | None
    relevancy: Map
    mask_level: int | None
    mask: Mask


def ask(
    scene: QueryScene,
    texts: Texts,
    camera: Camera,
    camera_to_world: Array,
    valid: Mask | None,
    options: QueryOptions,
) -> Iterator[Answer]:
    """Answer queries in one view of a scene.

    Args:
        scene: what is asked.
        texts: the queries, by the model that the scene's features were made with.
        camera, camera_to_world: of the picture that is asked.
        valid: (H, W) bool pixels that show the scene, or None for all.
        options: how queries are answered.

    Returns:
        The answers in the order of the queries.

    Raises:
        ValueError: see ``answer_from_codes``.
    """
    view = view_of(scene, camera, camera_to_world, valid, options.resolution)
    return answer_from_codes(view, scene.decoder, texts, options)


@torch.inference_mode()
def view_of(
    scene: QueryScene, camera: Camera, camera_to_world: Array, valid: Mask | None, resolution: int
) -> View:
    """One view's codes and depth; arguments as ``ask``, and ``resolution`` as in ``QueryOptions``."""
    drawn, settings = rendering_camera(camera, resolution), scene.settings
    codes = render_codes(scene.gaussians, scene.code, scene.share, drawn, camera_to_world, settings)
    depth, _, _ = render(
        scene.gaussians, drawn, camera_to_world, settings, sh_degree=0, background=None, render_mode="ED"
    )
    return View(codes.codes, codes.coverage, depth[..., 0], camera, camera_to_world, valid)


def rendering_camera(camera: Camera, resolution: int) -> Camera:
    """The camera with its longer side brought down to ``resolution`` [px]; itself where that is 0 or no less."""
    longer = max(camera.width, camera.height)
    if not 0 < resolution < longer:
        return camera
    width, height = (max(1, round(side * resolution / longer)) for side in (camera.width, camera.height))
    return camera.scaled_to(width, height)


def answer_from_codes(view: View, decoder: Decoder, texts: Texts, options: QueryOptions) -> Iterator[Answer]:
    """Answer queries in order, one at a time, because each answer holds maps of the picture's size.

    Args:
        view: what is asked.
        decoder: of its codes.
        texts: the queries.
        options: how they are answered; ``canonical`` is in the texts, ``resolution`` in the view already.

    Raises:
        ValueError: a code is not finite, or shapes do not belong together.
    """
    _check(view)
    height, width = view.camera.height, view.camera.width
    valid = np.ones((height, width), bool) if view.valid is None else view.valid
    seen = _seen(view, valid, options.min_coverage)
    there = torch.from_numpy(seen).to(view.codes.device)
    for part in texts.in_parts(max(1, _MAPS_AT_ONCE // seen.size)):
        maps = relevancy_maps(view.codes, there, decoder, part, options.temperature)
        for phrase, small in zip(part.phrases, maps, strict=True):
            levels = np.where(seen, small.cpu().numpy(), np.float32(np.nan))
            yield _answer(phrase, find_in_maps(levels, valid, options), view)


def _answer(phrase: str, found: Found | None, view: View) -> Answer:
    if found is None:
        nothing = np.zeros((view.camera.height, view.camera.width), np.float32)
        return Answer(phrase, 0.0, None, np.zeros((0, 2), np.int64), None, None, nothing, None, nothing > 0)
    location = found.location
    return Answer(
        phrase=phrase,
        score=location.score,
        level=location.level,
        candidates=location.candidates,
        pixel=location.pixel,
        position=pixel_position(view.camera, view.camera_to_world, location.pixel, view.depth.cpu().numpy()),
        relevancy=found.relevancy,
        mask_level=found.segmentation.level,
        mask=found.segmentation.mask,
    )


def _check(view: View) -> None:
    codes, size = tuple(view.codes.shape), (view.camera.height, view.camera.width)
    wanted = {"coverage": (view.coverage, codes[:3]), "depth": (view.depth, codes[1:3])}
    if view.valid is not None:
        wanted["valid"] = (view.valid, size)
    for name, (array, shape) in wanted.items():
        if len(codes) != 4 or tuple(array.shape) != shape:
            raise ValueError(f"{name} {tuple(array.shape)} does not belong to codes {codes}, picture {size}")


def _seen(view: View, valid: Mask, min_coverage: float) -> Mask:
    """(L, h, w) bool: what the codes' view shows of the scene."""
    height, width = view.depth.shape
    inside = cv2.resize(valid.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0
    return (view.coverage > min_coverage).cpu().numpy() & inside


def pixel_position(
    camera: Camera, camera_to_world: Array, pixel: tuple[int, int], depth: NDArray[np.float32]
) -> Array | None:
    """The place that a pixel's centre shows.

    Args:
        camera, camera_to_world: of the picture.
        pixel: column and row in it.
        depth: (h, w) float32 expected camera z [m], of the same view in any resolution.

    Returns:
        (3,) float64 in the world [m]; None where there is no depth (0, or not finite).
    """
    point = np.array(pixel) + 0.5
    height, width = depth.shape
    column, row = (point * [width / camera.width, height / camera.height]).astype(int)
    found = float(depth[row, column])
    if not (np.isfinite(found) and found > 0):
        return None
    return unproject(camera, camera_to_world, point, np.array(found))


def unproject(camera: Camera, camera_to_world: Array, points: Array, depth: Array) -> Array:
    """The places that image points show.

    Args:
        camera: pinhole camera.
        camera_to_world: (4, 4) float64.
        points: (..., 2) float64 image points [px].
        depth: (...,) float64 camera z [m].

    Returns:
        (..., 3) float64 in the world [m].
    """
    points, depth = np.asarray(points, np.float64), np.asarray(depth, np.float64)
    x = (points[..., 0] - camera.cx) / camera.fx
    y = (points[..., 1] - camera.cy) / camera.fy
    return transform(camera_to_world, np.stack([x, y, np.ones_like(x)], axis=-1) * depth[..., None])
