"""Query the whole scene: find the matching 3D things, and the view that shows each of them best."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Array, Camera, known_poses
from egosplat.images import evenly_spaced
from egosplat.progress import track
from egosplat.query.maps import Mask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene, rendering_camera
from egosplat.query.text import Texts
from egosplat.query.things import Surface, Thing, find_things
from egosplat.rasterize.view import sum_over_pixels

# Maximum number of rendered views, evenly spaced among the frames with a pose: they cover a whole recording.
MOST_VIEWS = 64

# Longer side of these views [px]: a thing of a thousandth of the image still has about 20 pixels.
VIEW_SIDE = 192

# Relevancies held at a time, 512 MiB in float32. More queries are answered in batches.
_NUMBERS_AT_ONCE = 2**27


@dataclass(frozen=True, eq=False)
class SceneIndex:
    """Data shared by all queries of a scene.

    Attributes:
        surface: the Gaussians with their neighbors and visible shares.
        frame: (V,) int64 frames of the rendered views.
    """

    scene: QueryScene
    surface: Surface
    frame: NDArray[np.int64]

    def best_frame(self, thing: Thing) -> int:
        """The frame that shows a thing best."""
        return int(self.frame[thing.view])


@dataclass(frozen=True, eq=False)
class SceneAnswer:
    """The answer to one query of a scene.

    Attributes:
        things: by decreasing score; empty if no Gaussian has a code.
    """

    phrase: str
    things: tuple[Thing, ...]


def index_scene(scene: QueryScene, camera_to_world: Array, camera: Camera, valid: Mask | None) -> SceneIndex:
    """Measure which Gaussians the frames of a recording show.

    Args:
        camera_to_world: (F, 4, 4) float64, NaN without a pose; at least one frame has one.
        valid: (H, W) bool pixels that show the scene, or None for all.
    """
    registered = known_poses(camera_to_world)
    frame = registered[evenly_spaced(len(registered), MOST_VIEWS)]
    small = rendering_camera(camera, VIEW_SIDE)
    seen = None if valid is None else _shrunk(valid, small)
    views = track(camera_to_world[frame], "rendering views", unit="view")
    shares = visible_shares(scene.gaussians, small, views, seen, scene.settings).cpu().numpy()
    return SceneIndex(scene, _surface(scene, shares), frame)


def ask_scene(index: SceneIndex, texts: Texts, options: QueryOptions, most: int) -> Iterator[SceneAnswer]:
    """Answer queries in order.

    Args:
        index: index of the scene.
        texts: the queries, encoded by the model that made the scene's features.
        options: ``temperature``, ``segmentation_threshold`` and ``box_filter`` are used.
        most: maximum number of things in an answer.
    """
    scene = index.scene
    levels, count = scene.share.shape[1], scene.share.shape[0]
    for batch in texts.in_batches(max(1, _NUMBERS_AT_ONCE // max(1, levels * count))):
        found = scene.relevancy(batch, options.temperature).cpu().numpy()
        for phrase, relevancy in zip(batch.phrases, found, strict=True):
            things = find_things(
                index.surface, relevancy, options.segmentation_threshold, options.box_filter, most
            )
            yield SceneAnswer(phrase, tuple(things))


def _surface(scene: QueryScene, shares: NDArray[np.float32]) -> Surface:
    gaussians = scene.gaussians
    means = gaussians.means.double().cpu().numpy()
    radii = gaussians.scales.amax(dim=1).double().cpu().numpy()
    return Surface.of(means, radii, shares, scene.share.cpu().numpy())


def visible_shares(
    gaussians: Gaussians, camera: Camera, poses: Iterable[Array], valid: Mask | None, settings: RenderSettings
) -> Tensor:
    """Share of each view that every Gaussian fills, with occlusion.

    Pixels count less towards the border, where things are cut off.

    Args:
        camera: camera of all views, at the resolution to measure in.
        poses: V (4, 4) float64 camera_to_world.
        valid: (height, width) bool pixels of the camera that show the scene, or None for all.

    Returns:
        (V, N) float32 on the device of the Gaussians; each row sums to at most about 1.
    """
    # An image is linear in the values of the Gaussians, so the transposed map of an image of ones sums the compositing
    # weights of each Gaussian.
    ones = torch.from_numpy(_window(camera, valid)).to(gaussians.means.device)
    views = (view_of(gaussians, camera, pose, settings) for pose in poses)
    rows = [sum_over_pixels(view, ones[..., None])[:, 0] for view in views]
    return torch.stack(rows) if rows else ones.new_zeros(0, gaussians.count)


def _window(camera: Camera, valid: Mask | None) -> np.ndarray:
    """(H, W) float32 weight of each pixel; the weights of all pixels sum to 1, invalid ones are set to 0."""
    # A half sine along each axis falls towards the border.
    down, right = (np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in (camera.height, camera.width))
    window = np.outer(down, right)
    window /= window.sum()
    return np.where(True if valid is None else valid, window, 0.0).astype(np.float32)


def _shrunk(valid: Mask, camera: Camera) -> Mask:
    """Sample a mask at the pixel centers of a smaller camera, (h, w) bool."""
    size = camera.width, camera.height
    return cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0
