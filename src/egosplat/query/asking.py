"""Asking a scene: the codes of one view are rendered, then answered from."""

from collections.abc import Iterator

import torch

from egosplat.codes.rendering import render_codes
from egosplat.gaussians.render import render
from egosplat.geometry import Array, Camera
from egosplat.query.answer import Answer, View, answer_from_codes
from egosplat.query.options import QueryOptions
from egosplat.query.scene import LanguageScene
from egosplat.query.smoothing import Mask
from egosplat.query.text import Texts


def ask(
    scene: LanguageScene,
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
    scene: LanguageScene, camera: Camera, camera_to_world: Array, valid: Mask | None, resolution: int
) -> View:
    """One view's codes and depth; arguments as ``ask``, and ``resolution`` as in ``QueryOptions``."""
    drawn, lens = rendering_camera(camera, resolution), scene.lens
    how = {"near_plane": lens.near_plane, "antialiased": lens.antialiased, "backend": lens.backend}
    codes = render_codes(scene.gaussians, scene.code, scene.share, drawn, camera_to_world, **how)
    depth, _, _ = render(
        scene.gaussians, drawn, camera_to_world, sh_degree=0, background=None, render_mode="ED", **how
    )
    return View(codes.codes, codes.coverage, depth[..., 0], camera, camera_to_world, valid)


def rendering_camera(camera: Camera, resolution: int) -> Camera:
    """The camera with its longer side brought down to ``resolution`` [px]; itself where that is 0 or no less."""
    longer = max(camera.width, camera.height)
    if not 0 < resolution < longer:
        return camera
    width, height = (max(1, round(side * resolution / longer)) for side in (camera.width, camera.height))
    return camera.scaled_to(width, height)
