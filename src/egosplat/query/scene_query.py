"""Queries asked of the whole scene: which things in 3D fit, and which view shows each of them best."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Camera
from egosplat.progress import track
from egosplat.query.asking import rendering_camera
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.scene import LanguageScene
from egosplat.query.smoothing import Mask
from egosplat.query.text import Texts
from egosplat.query.things import Surface, Thing, find_things
from egosplat.query.visibility import visible_shares

MOST_VIEWS = 64
"""Views that are looked at, evenly spaced among the frames with a pose: enough to see every part of a walk."""

VIEW_SIDE = 192
"""Longer side of these views [px]: a thing of a thousandth of the picture still has some 20 pixels."""

_NUMBERS_AT_ONCE = 2**27
"""Relevancies held at a time, 512 MiB in float32; more queries are asked in turn."""


@dataclass(frozen=True, eq=False)
class SceneIndex:
    """What all queries of a scene need; made once.

    Attributes:
        scene: the Gaussians and their codes.
        surface: the Gaussians as things are made of them.
        frame: (V,) int64 frames whose views were looked at.
    """

    scene: LanguageScene
    surface: Surface
    frame: NDArray[np.int64]

    def best_frame(self, thing: Thing) -> int:
        """The frame whose view shows a thing best."""
        return int(self.frame[thing.view])


@dataclass(frozen=True, eq=False)
class SceneAnswer:
    """What one query finds in a scene.

    Attributes:
        phrase: the query's words.
        things: by falling score; none where no Gaussian has a code.
    """

    phrase: str
    things: tuple[Thing, ...]

    @property
    def score(self) -> float:
        """Of the best thing; 0 without any."""
        return self.things[0].score if self.things else 0.0


def index_scene(scene: LanguageScene, poses: Artifact, camera: Camera, valid: Mask | None) -> SceneIndex:
    """Look at a scene from the frames of its recording.

    Args:
        scene: what is to be asked.
        poses: the poses artifact; one frame at least has a pose.
        camera: of the frames.
        valid: (H, W) bool pixels of a frame that show the scene, or None for all.
    """
    registered = np.flatnonzero(poses.read("registered"))
    count = min(MOST_VIEWS, len(registered))
    frame = registered[np.linspace(0, len(registered) - 1, count).round().astype(int)]
    small = rendering_camera(camera, VIEW_SIDE)
    seen = None if valid is None else _shrunk(valid, small)
    views = track(poses.read("camera_to_world")[frame], "looking around", unit="view")
    shares = visible_shares(scene.gaussians, small, views, seen, scene.lens).cpu().numpy()
    return SceneIndex(scene, _surface(scene, shares), frame)


def ask_scene(index: SceneIndex, texts: Texts, options: QueryOptions, most: int) -> Iterator[SceneAnswer]:
    """Answer queries in order.

    Args:
        index: of the scene.
        texts: the queries, by the model that the scene's features were made with.
        options: ``temperature``, ``segmentation_threshold`` and ``smoothing`` are used.
        most: things an answer names at most.
    """
    scene = index.scene
    levels, count = scene.share.shape[1], scene.share.shape[0]
    # A code is asked by itself here, not blended in a pixel: a picture of one column a level.
    codes = scene.code.movedim(1, 0)[:, :, None]
    seen = torch.from_numpy(index.surface.weight > 0).T[:, :, None].to(codes.device)
    for part in texts.in_parts(max(1, _NUMBERS_AT_ONCE // max(1, levels * count))):
        maps = relevancy_maps(codes, seen, scene.decoder, part, options.temperature)[..., 0]
        for phrase, relevancy in zip(part.phrases, maps.cpu().numpy(), strict=True):
            threshold, smoothing = options.segmentation_threshold, options.smoothing
            things = find_things(index.surface, relevancy, threshold, smoothing, most)
            yield SceneAnswer(phrase, tuple(things))


def _surface(scene: LanguageScene, shares: NDArray[np.float32]) -> Surface:
    gaussians = scene.gaussians
    means = gaussians.means.double().cpu().numpy()
    radii = gaussians.scales.amax(dim=1).double().cpu().numpy()
    return Surface.of(means, radii, shares, scene.share.cpu().numpy())


def _shrunk(valid: Mask, camera: Camera) -> Mask:
    """(h, w) bool: the mask at the pixel centres of a smaller camera."""
    size = camera.width, camera.height
    return cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0
