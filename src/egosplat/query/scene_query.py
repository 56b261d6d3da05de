"""Queries asked of the whole scene: which things in 3D fit, and which view shows each of them best."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.codes.rendering import sum_over_pixels
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.geometry import Array, Camera
from egosplat.progress import track
from egosplat.query.answer import rendering_camera
from egosplat.query.maps import Mask
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.scene import QueryScene
from egosplat.query.text import Texts
from egosplat.query.things import Surface, Thing, find_things

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

    scene: QueryScene
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


def index_scene(scene: QueryScene, poses: Artifact, camera: Camera, valid: Mask | None) -> SceneIndex:
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
    shares = visible_shares(scene.gaussians, small, views, seen, scene.settings).cpu().numpy()
    return SceneIndex(scene, _surface(scene, shares), frame)


def ask_scene(index: SceneIndex, texts: Texts, options: QueryOptions, most: int) -> Iterator[SceneAnswer]:
    """Answer queries in order.

    Args:
        index: of the scene.
        texts: the queries, by the model that the scene's features were made with.
        options: ``temperature``, ``segmentation_threshold`` and ``box_filter`` are used.
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
            threshold, box_side = options.segmentation_threshold, options.box_filter
            things = find_things(index.surface, relevancy, threshold, box_side, most)
            yield SceneAnswer(phrase, tuple(things))


def _surface(scene: QueryScene, shares: NDArray[np.float32]) -> Surface:
    gaussians = scene.gaussians
    means = gaussians.means.double().cpu().numpy()
    radii = gaussians.scales.amax(dim=1).double().cpu().numpy()
    return Surface.of(means, radii, shares, scene.share.cpu().numpy())


def visible_shares(
    gaussians: Gaussians, camera: Camera, poses: Iterable[Array], valid: Mask | None, settings: RenderSettings
) -> Tensor:
    """Share of each view that every Gaussian fills, with what stands in front of it taken into account.

    A picture is linear in the values of the Gaussians. The transposed map of a picture of ones therefore sums the
    compositing weights of each Gaussian. Pixels count less towards the border, where things are cut off: by a half sine
    along each axis, with mean 1 over the picture.

    Args:
        gaussians: the scene.
        camera: of all views, at the resolution to measure in.
        poses: V (4, 4) float64 camera_to_world.
        valid: (height, width) bool pixels of the camera that show the scene, or None for all.
        settings: how to render.

    Returns:
        (V, N) float32 on the device of the Gaussians, each row with a sum of at most about 1.
    """
    ones = torch.from_numpy(_window(camera, valid)).to(gaussians.means.device)
    rows = [sum_over_pixels(gaussians, ones[..., None], camera, pose, settings)[:, 0] for pose in poses]
    return torch.stack(rows) if rows else ones.new_zeros(0, gaussians.count)


def _window(camera: Camera, valid: Mask | None) -> np.ndarray:
    """(H, W) float32 share of the picture that each pixel counts as."""
    down, right = (np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in (camera.height, camera.width))
    window = np.outer(down, right)
    window /= window.sum()
    return np.where(True if valid is None else valid, window, 0.0).astype(np.float32)


def _shrunk(valid: Mask, camera: Camera) -> Mask:
    """(h, w) bool: the mask at the pixel centres of a smaller camera."""
    size = camera.width, camera.height
    return cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0
