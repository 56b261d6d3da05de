"""A camera with lens distortion, the pinhole camera that its pictures are rectified to, and ``camera.json``."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.geometry import Camera

# COLMAP's camera models without and with an angular (fisheye) projection. Its other models are rare. The last is Aria's
# FISHEYE624.
_PERSPECTIVE = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
_FISHEYE = ("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE")
MODELS = (*_PERSPECTIVE, *_FISHEYE)

# Points on each side of the picture at which the rectified field of view is measured.
_BORDER_POINTS = 200
# Largest error of undistorting and distorting a point again [px]. Above it, the distortion cannot be inverted.
_MAX_ROUND_TRIP_PX = 0.1
_ROWS_PER_BLOCK = 256
# Far enough outside the picture that bilinear sampling gives 0.
_OUTSIDE = -10.0

# The calibration of a plain recording: the numbers that the file must have, and those of OpenCV that it may have.
_KEYS = ("width", "height", "fx", "fy", "cx", "cy")
_DISTORTION = ("k1", "k2", "p1", "p2")


@dataclass(frozen=True)
class Lens:
    """A camera model of COLMAP with its parameters, for pictures of full size.

    Attributes:
        model: name of the model, such as ``OPENCV``.
        width, height: size of the pictures [px].
        params: in COLMAP's order: focal lengths, principal point [px], distortion.
        radius: of the lens circle about the principal point [px]; None if the whole picture shows the scene.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]
    radius: float | None = None

    @classmethod
    def of_facts(cls, facts: Mapping[str, Any]) -> "Lens":
        """The lens of a plain JSON object with its attributes."""
        return cls(**{**facts, "params": tuple(facts["params"])})

    def check(self, source: str) -> "Lens":
        """Return self; UserError, of ``source``, if the model is unsupported, a parameter impossible, or no ``pinhole``."""
        if self.model not in MODELS:
            raise UserError(
                f"{source}: camera model {self.model} is not supported. Supported: {', '.join(MODELS)}."
            )
        camera = self.colmap()
        if not camera.verify_params():
            raise UserError(
                f"{source}: {len(self.params)} parameters; {self.model} has {camera.params_info}."
            )
        finite = all(map(math.isfinite, self.params))
        fx, fy, cx, cy = self._linear()
        sizes = self.width, self.height, self.radius or 1, fx, fy
        if not (finite and min(sizes) > 0 and 0 <= cx < self.width and 0 <= cy < self.height):
            raise UserError(
                f"{source}: fx, fy must be positive, (cx, cy) inside the image, and all numbers finite."
            )
        try:
            _ = self.pinhole
        except UserError as error:
            raise UserError(f"{source}: {error}") from error
        return self

    def colmap(self) -> pycolmap.Camera:
        """This camera as pycolmap represents it."""
        return pycolmap.Camera(
            model=self.model, width=self.width, height=self.height, params=list(self.params)
        )

    def _linear(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point [px]."""
        (fx, _, cx), (_, fy, cy), _ = self.colmap().calibration_matrix().tolist()
        return fx, fy, cx, cy

    @property
    def is_pinhole(self) -> bool:
        """Whether the camera has no distortion."""
        camera = self.colmap()
        extra = [self.params[index] for index in camera.extra_params_idxs()]
        return self.model in _PERSPECTIVE and not any(extra)

    @cached_property
    def pinhole(self) -> Camera:
        """The pinhole camera of the rectified pictures: of the same size, with the largest view without blank pixels.

        A camera without distortion is returned as it is.

        Raises:
            UserError: the view is too wide for a pinhole camera, or the distortion cannot be inverted.
        """
        fx, fy, cx, cy = self._linear()
        if self.is_pinhole:
            return Camera(self.width, self.height, fx, fy, cx, cy)
        left, top, right, bottom = self.inner_view()
        zoom = max(self.width / (fx * (right - left)), self.height / (fy * (bottom - top)))
        fx, fy = fx * zoom, fy * zoom
        # As near to the lens's principal point as the view allows.
        cx = float(np.clip(cx, self.width - right * fx, -left * fx))
        cy = float(np.clip(cy, self.height - bottom * fy, -top * fy))
        return Camera(self.width, self.height, fx, fy, cx, cy)

    def _border(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom [px] of the picture, or of the square in the lens circle."""
        # Half a pixel inside, so that bilinear sampling has all its neighbors.
        left, top, right, bottom = 0.5, 0.5, self.width - 0.5, self.height - 0.5
        if self.radius is None:
            return left, top, right, bottom
        (_, _, cx, cy), half = self._linear(), self.radius / math.sqrt(2)
        return max(left, cx - half), max(top, cy - half), min(right, cx + half), min(bottom, cy + half)

    def inner_view(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom of the largest rectangle in the undistorted border of the picture, at depth 1."""
        along = np.linspace(0.0, 1.0, _BORDER_POINTS)
        left, top, right, bottom = self._border()
        x, y = left + along * (right - left), top + along * (bottom - top)
        sides = [(left, y), (x, top), (right, y), (x, bottom)]
        border = np.concatenate([np.stack(np.broadcast_arrays(*side), 1) for side in sides])
        rays = self.colmap().cam_from_img(border)
        again = self.colmap().img_from_cam(np.column_stack([rays, np.ones(len(rays))]))
        if not (np.abs(again - border) <= _MAX_ROUND_TRIP_PX).all():
            raise UserError(
                f"the {self.model} lens {list(self.params)} cannot be rectified to a pinhole camera: its view is "
                "too wide, or the distortion folds the picture. Crop the pictures, or calibrate again."
            )
        west, north, east, south = np.split(rays, 4)
        view = west[:, 0].max(), north[:, 1].max(), east[:, 0].min(), south[:, 1].min()
        if not (view[0] < 0 < view[2] and view[1] < 0 < view[3]):
            raise UserError(f"the {self.model} lens {list(self.params)} leaves no view: calibrate again.")
        left, top, right, bottom = map(float, view)
        return left, top, right, bottom

    def scaled_to(self, width: int, height: int) -> "Lens":
        """The lens of the pictures resized to ``width`` x ``height``; ValueError if it is not radial."""
        if self.model != "RADIAL":
            raise ValueError(f"only radial lenses are scaled, not {self.model}")
        f, cx, cy, k1, k2 = self.params
        x, y = width / self.width, height / self.height
        return Lens("OPENCV", width, height, (f * x, f * y, cx * x, cy * y, k1, k2, 0.0, 0.0))

    def bend_px(self, other: Camera, pixels: NDArray[np.float64]) -> float:
        """Largest distance [px] between where this lens and a pinhole camera show the rays of (N, 2) pixels."""
        rays = self.colmap().cam_from_img(pixels)
        shown = rays * [other.fx, other.fy] + [other.cx, other.cy]
        return float(np.linalg.norm(shown - pixels, axis=1).max())


def shared_pinhole(lenses: Sequence[Lens], share: Sequence[int]) -> Camera:
    """The largest view that all lenses show, of the pictures' median focal length; UserError if that is below a pixel."""
    if len(lenses) == 1:
        return lenses[0].pinhole
    views = np.array([lens.inner_view() for lens in lenses])
    left, top, right, bottom = *views[:, :2].max(axis=0).tolist(), *views[:, 2:].min(axis=0).tolist()
    focal = float(np.median(np.repeat([lens.pinhole.fx for lens in lenses], share)))
    width, height = math.floor((right - left) * focal), math.floor((bottom - top) * focal)
    if min(width, height) < 1:
        raise UserError(
            f"the {len(lenses)} cameras of the known poses share no view: make a scene of the pictures of each."
        )
    return Camera(width, height, focal, focal, -left * focal, -top * focal)


class Rectifier:
    """Maps full-size pictures, label maps and masks of a lens to a pinhole camera."""

    def __init__(self, lens: Lens, target: Camera | None = None) -> None:
        """Compute where each pixel of the pinhole camera ``target``, by default that of the lens, lies in the picture."""
        target = target or lens.pinhole
        self.is_identity = lens.is_pinhole and target == lens.pinhole
        if not self.is_identity:
            self._u, self._v = _source_positions(lens, target)

    def image(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 picture -> (H, W, 3) uint8 of the pinhole camera, sampled bilinearly."""
        if self.is_identity:
            return picture
        return cv2.remap(picture, self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(H, W) bool -> (H, W) bool of the pinhole camera: True where all sampled pixels are in the mask."""
        if self.is_identity:
            return mask
        # Neighbors outside the picture do not count, as ``image`` repeats its border.
        filled = cv2.remap(
            mask.astype(np.float32), self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return filled > 1 - 1e-4

    def labels(self, labels: NDArray[np.int32]) -> NDArray[np.int32]:
        """(H, W) labels -> (H, W) labels of the pinhole camera, by nearest neighbor."""
        if self.is_identity:
            return labels
        height, width = labels.shape
        rows = np.clip(np.rint(self._v), 0, height - 1).astype(np.int64)
        columns = np.clip(np.rint(self._u), 0, width - 1).astype(np.int64)
        return labels[rows, columns]


def _source_positions(lens: Lens, target: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Column and row, (H, W) float32 [px, pixel centers at integers as in OpenCV], of each pixel of the pinhole camera."""
    camera = lens.colmap()
    positions = np.empty((target.height, target.width, 2), np.float32)
    x = (np.arange(target.width) + 0.5 - target.cx) / target.fx
    for start in range(0, target.height, _ROWS_PER_BLOCK):
        y = (np.arange(start, min(start + _ROWS_PER_BLOCK, target.height)) + 0.5 - target.cy) / target.fy
        rays = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
        shown = camera.img_from_cam(rays.reshape(-1, 3)).reshape(len(y), len(x), 2)
        positions[start : start + len(y)] = np.nan_to_num(shown - 0.5, nan=_OUTSIDE)
    return np.ascontiguousarray(positions[..., 0]), np.ascontiguousarray(positions[..., 1])


def read_camera_file(path: Path, width: int, height: int) -> Lens:
    """Read ``camera.json``; UserError if it is damaged, for pictures of another size than the given, or not possible."""
    try:
        entries = read_json(path)
        numbers = [float(entries[key]) for key in _KEYS]
        distortion = [float(entries.get(key, 0.0)) for key in _DISTORTION]
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise UserError(
            f"{path}: not an object with the numbers {', '.join(_KEYS)} ({repr(error)[:200]})."
        ) from error
    if other := [key for key in entries if key not in (*_KEYS, *_DISTORTION)]:
        raise UserError(
            f"{path}: {', '.join(other)[:200]}: not read; it has {', '.join((*_KEYS, *_DISTORTION))}."
        )
    if (numbers[0], numbers[1]) != (width, height):
        raise UserError(f"{path}: for {numbers[0]:g}x{numbers[1]:g} px, but the frames are {width}x{height}.")
    return Lens("OPENCV", width, height, (*numbers[2:], *distortion)).check(str(path))
