"""What the frames show of the ends of carries: small crops around each."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import groupby

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Array, Bools, Bytes, Ints, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import is_track
from egosplat.gaussians.exposure import expose
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import TrainedScene, render
from egosplat.geometry import Camera, invert, transform
from egosplat.images import evenly_spaced, shrunk_size
from egosplat.progress import track

# Longer side of the renders that give the depth [px]: a place needs no finer surface.
_SIDE = 256
# A crop goes beyond the place by so many pixels, and is no smaller than this.
_MARGIN, _SMALLEST = 8, 12
# A place is nearer than the surface that hides it by more than its radius and this share of its depth, which Gaussians tell no better.
_OF_DEPTH = 0.04
# A place is looked at in twice as many views at most: a thing that rests for an hour needs no more. So many views of all places are held.
_MOST, _VIEWS_AT_ONCE = 256, 4096
# Views whose Gaussians of the scene are kept for the next iterations, a megabyte each.
_KEPT = 128
# A Gaussian ends at so many of its standard deviations.
_REACH = 3.0


@dataclass(frozen=True, eq=False)
class Recording(TrainedScene):
    """The frames of a recording, (F, 4, 4) float64 poses, and the Gaussians of its scene on the renderer's device, which stay
    as they are.

    Attributes:
        seed: of all random choices.
        log_gains, compression: (F, 3) of the exposure, and of highlights, see ``egosplat.gaussians.exposure``; None for 0.
    """

    frames: Artifact
    instances: Artifact
    masks: Artifact | None
    seed: int
    camera_to_world: Array
    log_gains: Tensor | None
    compression: Tensor | None

    @cached_property
    def valid(self) -> Bools:
        """(H, W) bool pixels that show the scene."""
        return self.frames.read("valid")

    @cached_property
    def is_track(self) -> Bools:
        """(N,) bool instances that are tracks."""
        return is_track(self.instances)

    def moving(self, frame: int, labels: Ints32) -> Bools:
        """(H, W) bool pixels of what moves in a frame with these labels: tracks, and refined masks if there are any."""
        # Label -1 indexes the last entry.
        tracks = np.asarray(np.append(self.is_track, False)[labels].any(axis=0))
        return tracks if self.masks is None else tracks | self.masks.row("refined", frame)

    @torch.inference_mode()
    def depth(self, frame: int) -> Array:
        """(h, w) float64 expected camera z [m] of the surfaces that the scene shows in a frame; 0 where it is empty."""
        small = self.camera.scaled_to(*shrunk_size(self.camera.width, self.camera.height, _SIDE))
        view = self.gaussians, small, self.camera_to_world[frame], self.settings
        surface, _, _ = render(*view, sh_degree=0, background=None, render_mode="ED")
        return surface[..., 0].double().cpu().numpy()


@dataclass(frozen=True, eq=False)
class End:
    """An end of the carry of a number, at a ``second``, before or ``after`` which a thing of a size [m] rests in a sphere [m].

    ``track`` is the instance of the thing in instances.zarr; its own masks do not hide it.
    """

    carry: int
    after: bool
    center: Array
    radius: float
    size: float
    second: float
    track: int


@dataclass(frozen=True, eq=False)
class PlaceView:
    """A crop of a training frame around an end of a carry: its column and row in the frame, its camera, (h, w, 3) uint8 sRGB,
    (K,) int64 Gaussians of the scene that may reach into it, and the (h, w) bool pixels that show the scene, and nothing else
    that moves."""

    recording: Recording
    frame: int
    corner: tuple[int, int]
    camera: Camera
    camera_to_world: Array
    near: Tensor
    picture: Bytes
    shown: Bools

    @property
    def colors(self) -> Tensor:
        """(h, w, 3) float32 in [0, 1]."""
        return torch.from_numpy(self.picture).float() / 255.0

    @cached_property
    def error(self) -> Tensor:
        """(h, w) ``error_with`` the scene alone."""
        return self.error_with(self.recording.gaussians.select(self.near[:0]))

    def error_with(self, more: Gaussians) -> Tensor:
        """(h, w) absolute error, summed over colors, with more Gaussians than the scene's."""
        image = self.render(more)
        return (image.clamp(0.0, 1.0) - self.colors.to(image)).abs().sum(dim=-1)

    def with_scene(self, more: Gaussians) -> Gaussians:
        """The Gaussians of the scene that may be seen here, then more."""
        return Gaussians.concatenate([_scene_near(self), more])

    def render(self, more: Gaussians) -> Tensor:
        """Render (h, w, 3) as the camera would take it, with more Gaussians than the scene's."""
        recording = self.recording
        scene = replace(recording, gaussians=self.with_scene(more))
        image = scene.rendered(self.camera, self.camera_to_world)
        if recording.log_gains is None:
            return image
        log_gain, colors = recording.log_gains[self.frame], self.colors.to(image)
        return expose(image, log_gain, recording.compression, colors)


@lru_cache(_KEPT)
def _scene_near(view: PlaceView) -> Gaussians:
    return view.recording.gaussians.select(view.near)


def find_views(
    ends: Sequence[End], frames: Ints, seconds: Array, recording: Recording
) -> list[dict[int, list[int]]]:
    """Those of ``frames`` that show the place of each end, with its crop, left, top, right and bottom; of many the nearest by
    ``seconds`` (F,), and others evenly spaced."""
    centers = np.array([end.center for end in ends]).reshape(-1, 3)
    radii, found = np.array([end.radius for end in ends]), list[dict[int, list[int]]]({} for _ in ends)
    for frame in track(frames.tolist(), "looking for places", unit="frame"):
        points = transform(invert(recording.camera_to_world[frame]), centers)
        shown, crops = _crops(points, radii, recording)
        inside = np.flatnonzero(shown)
        if len(inside):
            seen = _are_open(points[inside], radii[inside], recording.camera, recording.depth(frame))
            for number in inside[seen].tolist():
                found[number][frame] = crops[number].tolist()
    for number, (own, end) in enumerate(zip(found, ends, strict=True)):
        nearest = np.argsort(np.abs(seconds[[*own]] - end.second), kind="stable")[:_MOST].tolist()
        kept, every = sorted({*nearest, *evenly_spaced(len(own), _MOST)}), [*own.items()]
        found[number] = dict(every[place] for place in kept)
    return found


def see_places(
    ends: Sequence[End], crops: Sequence[Mapping[int, Sequence[int]]], recording: Recording
) -> Iterator[list[PlaceView]]:
    """Yield the views of the place of each end in the frames of its ``crops``, see ``find_views``. Those of a few ends are held at once."""
    means = recording.gaussians.means.double().cpu().numpy()
    reach = _REACH * recording.gaussians.scales.amax(dim=1).double().cpu().numpy()
    batch = np.cumsum([len(own) for own in crops]) // _VIEWS_AT_ONCE
    for part in np.split(np.arange(len(ends)), np.flatnonzero(np.diff(batch)) + 1):
        views: dict[int, list[PlaceView]] = {number: [] for number in part.tolist()}
        pairs = sorted((frame, number) for number in views for frame in crops[number])
        for frame, numbers in groupby(track(pairs, "looking at places", unit="view"), lambda pair: pair[0]):
            pose, full = recording.camera_to_world[frame], recording.camera
            picture, labels = recording.frames.row("rgb", frame), recording.instances.row("labels", frame)
            shows = recording.valid & ~recording.moving(frame, labels)
            local = transform(invert(pose), means)
            for _, number in numbers:
                left, top, right, bottom = crops[number][frame]
                cut = np.s_[top:bottom, left:right]
                own = (labels[:, *cut] == ends[number].track).any(axis=0) & recording.valid[cut]
                camera = Camera(right - left, bottom - top, full.fx, full.fy, full.cx - left, full.cy - top)
                near, colors = _near(local, reach, camera), picture[cut].copy()
                cropped = (left, top), camera, pose, near, colors, shows[cut] | own
                views[number].append(PlaceView(recording, frame, *cropped))
        yield from views.values()


def _crops(points: Array, radii: Array, recording: Recording) -> tuple[Bools, Ints]:
    """Crops around (E, 3) points in the camera's axes: (E,) whether the point is in the picture, and its crop large enough; and
    (E, 4) left, top, right and bottom of those."""
    camera, pixels = recording.camera, recording.camera.project(points)
    inside = (points[:, 2] >= recording.settings.near_plane + radii) & camera.contains(pixels)
    middle, depth = np.where(inside[:, None], pixels, 0.0), np.where(inside, points[:, 2], 1.0)
    reach = (camera.fx * radii / depth + _MARGIN)[:, None]
    first = np.maximum((middle - reach).astype(np.int64), 0)
    last = np.minimum((middle + reach).astype(np.int64) + 1, (camera.width, camera.height))
    return inside & ((last - first).min(axis=1) >= _SMALLEST), np.hstack([first, last])


def _are_open(points: Array, radii: Array, camera: Camera, depth: Array) -> Bools:
    """(E,) whether no surface of the scene hides each of (E, 3) points in the camera's axes."""
    cell = camera.project(points) * depth.shape[::-1] / (camera.width, camera.height)
    column, row = cell.astype(np.int64).T
    surface = depth[row, column]
    return ~((surface > 0) & (surface < points[:, 2] * (1 - _OF_DEPTH) - radii))


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
