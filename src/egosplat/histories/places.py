"""What the training frames show of places where things rest: small crops around each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.exposure import expose
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.geometry import Array, Camera, invert, transform
from egosplat.images import shrunk_size
from egosplat.progress import track

Mask = NDArray[np.bool_]

# Longer side of the renders that give the depth [px]: a place needs no finer surface.
_SIDE = 256
# A crop goes beyond the place by so many pixels, and is no smaller than this.
_MARGIN, _SMALLEST = 8, 12
# A place is nearer than the surface that hides it by more than its radius and this share of its depth, which Gaussians tell no better.
_OF_DEPTH = 0.04
# A Gaussian ends at so many of its standard deviations.
_REACH = 3.0


@dataclass(frozen=True, eq=False)
class Scenery:
    """The Gaussians of a scene, which stay as they are.

    Attributes:
        gaussians: on the device of the renderer.
        sh_degree: degree in use.
        seed: of all random choices.
        compression: of highlights by the camera, see ``egosplat.gaussians.exposure``; None for 0.
    """

    gaussians: Gaussians
    settings: RenderSettings
    sh_degree: int
    seed: int
    compression: Tensor | None = None


@dataclass(frozen=True, eq=False)
class Place:
    """Where a thing rests.

    Attributes:
        center: (3,) float64 [m].
        radius: of the sphere that holds the thing [m].
        track: instance of the thing in instances.zarr; its own masks do not hide it.
    """

    center: Array
    radius: float
    track: int


@dataclass(frozen=True, eq=False)
class PlaceView:
    """A crop of a training frame around a place.

    Attributes:
        frame: index in frames.zarr.
        corner: column and row of the crop in the frame [px].
        camera: of the crop.
        near: (K,) int64 Gaussians of the scene that may reach into it.
        picture: (h, w, 3) uint8 sRGB.
        shown: (h, w) bool pixels that show the scene, and nothing else that moves.
        log_gain: (3,) of the frame's exposure; None for 0.
    """

    frame: int
    corner: tuple[int, int]
    camera: Camera
    camera_to_world: Array
    near: Tensor
    picture: NDArray[np.uint8]
    shown: Mask
    log_gain: Tensor | None

    @property
    def colors(self) -> Tensor:
        """(h, w, 3) float32 in [0, 1]."""
        return torch.from_numpy(self.picture).float() / 255.0

    def with_scene(self, scene: Scenery, more: Gaussians | None) -> Gaussians:
        """The Gaussians of the scene that may be seen here, then more."""
        near = scene.gaussians.select(self.near)
        return near if more is None else Gaussians.concatenate([near, more])

    def render(self, scene: Scenery, more: Gaussians | None = None) -> Tensor:
        """Render (h, w, 3) as the camera would take it, with more Gaussians than the scene's."""
        image, _, _ = render(
            self.with_scene(scene, more),
            self.camera,
            self.camera_to_world,
            scene.settings,
            sh_degree=scene.sh_degree,
            background=scene.settings.still_background,
        )
        if self.log_gain is None:
            return image[..., :3]
        colors = self.colors.to(image)
        return expose(image[..., :3], self.log_gain, scene.compression, colors)


@dataclass(frozen=True, eq=False)
class Recording:
    """What views of places are cut from; functions take the index of a frame.

    Attributes:
        picture: (H, W, 3) uint8.
        labels: (L, H, W) int32 instances.
        moving: (H, W) bool pixels of what moves; also takes the labels of the frame.
        depth: (h, w) float64 camera z of the scene, at any size [m].
        log_gain: (3,) of the exposure; None for 0.
        valid: (H, W) bool pixels that show the scene.
        camera_to_world: (F, 4, 4) float64.
    """

    picture: Callable[[int], NDArray[np.uint8]]
    labels: Callable[[int], NDArray[np.int32]]
    moving: Callable[[int, NDArray[np.int32]], Mask]
    depth: Callable[[int], Array]
    log_gain: Callable[[int], Tensor | None]
    valid: Mask
    camera: Camera
    camera_to_world: Array


def scene_depth(scene: Scenery, camera: Camera, camera_to_world: Array) -> Callable[[int], Array]:
    """Tell the (h, w) float64 expected camera z [m] of the surfaces that the scene shows in a frame; 0 where it is empty."""
    small = camera.scaled_to(*shrunk_size(camera.width, camera.height, _SIDE))

    @torch.inference_mode()
    def depth(frame: int) -> Array:
        view = scene.gaussians, small, camera_to_world[frame], scene.settings
        surface, _, _ = render(*view, sh_degree=0, background=None, render_mode="ED")
        return surface[..., 0].double().cpu().numpy()

    return depth


def see_places(
    places: Sequence[Place], frames: NDArray[np.int64], recording: Recording, scene: Scenery
) -> list[list[PlaceView]]:
    """Cut the views of each place, in the order of ``frames``, each of which is read once."""
    means = scene.gaussians.means.double().cpu().numpy()
    reach = _REACH * scene.gaussians.scales.amax(dim=1).double().cpu().numpy()
    found: list[list[PlaceView]] = [[] for _ in places]
    for frame in track(frames.tolist(), "looking at places", unit="frame"):
        pose = recording.camera_to_world[frame]
        crops = {
            number: crop
            for number, place in enumerate(places)
            if (crop := _crop_of(place, recording.camera, pose, scene.settings.near_plane)) is not None
        }
        depth = recording.depth(frame) if crops else np.zeros((1, 1))
        crops = {
            number: crop
            for number, crop in crops.items()
            if _is_open(places[number], recording.camera, pose, depth)
        }
        if crops:
            cut = _cutter(frame, recording, transform(invert(pose), means), reach)
            for number, crop in crops.items():
                found[number].append(cut(*crop, places[number].track))
    return found


def _cutter(frame: int, recording: Recording, local: Array, reach: Array) -> Callable[..., PlaceView]:
    """Read a frame once for all places; the scene's Gaussians are at (N, 3) points of its camera's axes, with their (N,) reach."""
    picture, labels = recording.picture(frame), recording.labels(frame)
    moving, full = recording.moving(frame, labels), recording.camera

    def cut(left: int, top: int, right: int, bottom: int, track: int) -> PlaceView:
        part = np.s_[top:bottom, left:right]
        own = (labels[:, top:bottom, left:right] == track).any(axis=0)
        camera = Camera(right - left, bottom - top, full.fx, full.fy, full.cx - left, full.cy - top)
        near, pose = _near(local, reach, camera), recording.camera_to_world[frame]
        shown, log_gain = recording.valid[part] & (own | ~moving[part]), recording.log_gain(frame)
        return PlaceView(frame, (left, top), camera, pose, near, picture[part].copy(), shown, log_gain)

    return cut


def _crop_of(
    place: Place, camera: Camera, pose: Array, near_plane: float
) -> tuple[int, int, int, int] | None:
    """Left, top, right and bottom of a crop around a place whose middle is in the picture; else None."""
    local = transform(invert(pose), place.center)
    if local[2] < near_plane + place.radius or not camera.contains(camera.project(local)):
        return None
    x, y = camera.project(local)
    reach = camera.fx * place.radius / local[2] + _MARGIN
    left, top = max(0, int(x - reach)), max(0, int(y - reach))
    right, bottom = min(camera.width, int(x + reach) + 1), min(camera.height, int(y + reach) + 1)
    return (left, top, right, bottom) if min(right - left, bottom - top) >= _SMALLEST else None


def _is_open(place: Place, camera: Camera, pose: Array, depth: Array) -> bool:
    """Whether no surface of the scene hides the middle of a place."""
    local = transform(invert(pose), place.center)
    x, y = camera.project(local)
    row, column = int(y * depth.shape[0] / camera.height), int(x * depth.shape[1] / camera.width)
    surface = depth[row, column]
    return not 0 < surface < local[2] * (1 - _OF_DEPTH) - place.radius


def _near(local: Array, reach: Array, camera: Camera) -> Tensor:
    """Gaussians, at (N, 3) points in the camera's axes, that may reach into its picture."""
    x, y, z = local.T
    ahead = z + reach > 0
    z = np.maximum(z, np.finfo(np.float64).tiny)
    wide, high = reach * camera.fx, reach * camera.fy
    u, v = camera.fx * x, camera.fy * y
    inside = (u + wide > -camera.cx * z) & (u - wide < (camera.width - camera.cx) * z)
    inside &= (v + high > -camera.cy * z) & (v - high < (camera.height - camera.cy) * z)
    return torch.from_numpy(np.flatnonzero(ahead & inside))
