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

from egosplat.errors import UserError, reraise_as
from egosplat.files import read_json
from egosplat.geometry import Camera

# COLMAP's camera models without and with an angular (fisheye) projection. Its other models are rare.
_PERSPECTIVE = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
_FISHEYE = ("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE")
_UNDISTORT = "colmap image_undistorter --image_path IMAGES --input_path MODEL --output_path NEW, and give NEW"

# Points on each side of the picture at which the rectified field of view is measured.
_BORDER_POINTS = 200
# Largest error of undistorting and distorting a point again [px]. Above it, the distortion cannot be inverted.
_MAX_ROUND_TRIP_PX = 0.1
_ROWS_PER_BLOCK = 256
# What cameras can have: focal lengths in units of the longer side (views of 157 to 1.9 degrees), how often one holds the other
# (2 with an anamorphic lens), and by how much distortion magnifies. What is outside has another unit, or is damaged.
SHORTEST, LONGEST, _UNEVEN, _MAGNIFIED = 0.1, 30.0, 3.0, 3.0
# Far enough outside the picture that bilinear sampling gives 0.
_OUTSIDE = -10.0

# The calibration of a plain recording: the numbers that the file must have, and those of OpenCV that it may have.
_KEYS, _DISTORTION = ("width", "height", "fx", "fy", "cx", "cy"), ("k1", "k2", "p1", "p2")


@dataclass(frozen=True)
class Lens:
    """A camera model of COLMAP with its parameters, for pictures of full size.

    Attributes:
        model: name of the model, such as ``OPENCV``.
        width, height: size of the pictures [px].
        params: in COLMAP's order: focal lengths, principal point [px], distortion.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    @classmethod
    def of_facts(cls, facts: Mapping[str, Any]) -> "Lens":
        """The lens of a plain JSON object with its attributes."""
        return cls(**{**facts, "params": tuple(facts["params"])})

    @classmethod
    def of_colmap(cls, camera: pycolmap.Camera) -> "Lens":
        """The lens of a camera of pycolmap."""
        return cls(camera.model_name, camera.width, camera.height, tuple(map(float, camera.params)))

    def colmap(self) -> pycolmap.Camera:
        """This camera as pycolmap represents it."""
        size = {"width": self.width, "height": self.height}
        return pycolmap.Camera(model=self.model, params=list(self.params), **size)

    def check(self, source: str) -> "Lens":
        """Return self; UserError, of ``source``, if the model is unsupported, a parameter impossible, or no ``pinhole``."""
        if self.model not in (*_PERSPECTIVE, *_FISHEYE):
            raise UserError(f"{source}: camera {self.model} is not supported. Undistort it: {_UNDISTORT}.")
        fx, fy, cx, cy = self._linear()
        sizes = (cx, self.width), (cy, self.height)
        # Normalized ones are about a half of a pixel.
        inside = all(min(1, size / 2) <= place <= size - min(1, size / 2) for place, size in sizes)
        least, most = (limit * max(self.width, self.height) for limit in (SHORTEST, LONGEST))
        usual = least <= min(fx, fy) and max(fx, fy) <= min(most, _UNEVEN * min(fx, fy))
        if not (np.isfinite(self.params).all() and usual and inside):
            bounds = f"in pixels, {least:g} to {most:g}, one at most {_UNEVEN:g} times the other"
            rule = f"fx, fy must be {bounds}, (cx, cy) inside, and all numbers finite"
            given = f"{self.model} {list(self.params)} of {self.width}x{self.height} px"
            raise UserError(f"{source}: {rule}, not {given}.")
        with reraise_as(lambda error: UserError(f"{source}: {error}"), (UserError,)):
            _ = self.pinhole
        return self

    def _linear(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point [px]."""
        (fx, _, cx), (_, fy, cy), _ = self.colmap().calibration_matrix().tolist()
        return fx, fy, cx, cy

    @property
    def is_pinhole(self) -> bool:
        """Whether the camera has no distortion."""
        return self.model in _PERSPECTIVE and self.colmap().is_undistorted()

    @cached_property
    def pinhole(self) -> Camera:
        """The pinhole camera of the rectified pictures: of the same size, with the largest view without blank
        pixels. A camera without distortion is returned as it is. UserError as for ``inner_view``."""
        fx, fy, cx, cy = self._linear()
        if self.is_pinhole:
            return Camera(self.width, self.height, fx, fy, cx, cy)
        left, top, right, bottom = self.inner_view()
        zoom = max(self.width / (fx * (right - left)), self.height / (fy * (bottom - top)))
        if zoom > _MAGNIFIED:
            told = f"{self.model} lens {list(self.params)} magnifies the picture {zoom:.3g} times"
            raise UserError(f"the {told}. Calibrate again.")
        fx, fy = fx * zoom, fy * zoom
        # As near to the lens's principal point as the view allows.
        cx = float(np.clip(cx, self.width - right * fx, -left * fx))
        cy = float(np.clip(cy, self.height - bottom * fy, -top * fy))
        return Camera(self.width, self.height, fx, fy, cx, cy)

    def inner_view(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom of the largest rectangle in the undistorted border of the picture, at
        depth 1. UserError if the view is too wide for a pinhole camera, or the distortion cannot be
        inverted."""
        # Half a pixel inside, so that bilinear sampling has all its neighbors.
        along = np.linspace(0.0, 1.0, _BORDER_POINTS)
        x, y = 0.5 + along * (self.width - 1), 0.5 + along * (self.height - 1)
        sides = [(0.5, y), (x, 0.5), (self.width - 0.5, y), (x, self.height - 0.5)]
        border = np.concatenate([np.stack(np.broadcast_arrays(*side), 1) for side in sides])
        camera = self.colmap()
        rays = camera.cam_from_img(border)
        assert rays is not None
        again = camera.img_from_cam(np.column_stack([rays, np.ones(len(rays))]))
        west, north, east, south = np.split(rays, 4)
        view = west[:, 0].max(), north[:, 1].max(), east[:, 0].min(), south[:, 1].min()
        if (np.abs(again - border) <= _MAX_ROUND_TRIP_PX).all() and max(view[:2]) < 0 < min(view[2:]):
            left, top, right, bottom = map(float, view)
            return left, top, right, bottom
        raise UserError(
            f"the {self.model} lens {list(self.params)} cannot be rectified to a pinhole camera: its view is "
            "too wide, or the distortion folds the picture. Crop the pictures, or calibrate again."
        )

    def scaled_to(self, width: int, height: int) -> "Lens":
        """The lens, a radial one, of the pictures resized to ``width`` x ``height``."""
        f, cx, cy, k1, k2 = self.params
        x, y = width / self.width, height / self.height
        return Lens("OPENCV", width, height, (f * x, f * y, cx * x, cy * y, k1, k2, 0.0, 0.0))


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
    """Maps full-size pictures, label maps and masks of a lens to a pinhole camera, by default that of the lens."""

    def __init__(self, lens: Lens, target: Camera | None = None) -> None:
        target = target or lens.pinhole
        self.is_identity = lens.is_pinhole and target == lens.pinhole
        if self.is_identity:
            return
        # Of each pixel of the pinhole camera, column and row in the picture [px, pixel centers at integers as in OpenCV].
        camera = lens.colmap()
        self._u, self._v = np.empty((2, target.height, target.width), np.float32)
        x = (np.arange(target.width) + 0.5 - target.cx) / target.fx
        for start in range(0, target.height, _ROWS_PER_BLOCK):
            y = (np.arange(start, min(start + _ROWS_PER_BLOCK, target.height)) + 0.5 - target.cy) / target.fy
            rays = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
            shown = np.asarray(camera.img_from_cam(rays.reshape(-1, 3))).reshape(len(y), len(x), 2)
            rows = np.s_[start : start + len(y)]
            self._u[rows], self._v[rows] = np.moveaxis(np.nan_to_num(shown - 0.5, nan=_OUTSIDE), -1, 0)

    def image(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 picture -> (H, W, 3) uint8 of the pinhole camera, sampled bilinearly."""
        return picture if self.is_identity else np.asarray(self._sampled(picture), np.uint8)

    def mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(H, W) bool -> (H, W) bool of the pinhole camera: True where all sampled pixels are in the mask."""
        return mask if self.is_identity else self._sampled(mask.astype(np.float32)) > 1 - 1e-4

    def _sampled(self, values: NDArray) -> NDArray:
        # Neighbors outside the picture do not count: its border is repeated.
        return cv2.remap(values, self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def labels(self, labels: NDArray[np.int32]) -> NDArray[np.int32]:
        """(H, W) labels -> (H, W) labels of the pinhole camera, by nearest neighbor."""
        if self.is_identity:
            return labels
        height, width = labels.shape
        rows = np.clip(np.rint(self._v), 0, height - 1).astype(np.int64)
        columns = np.clip(np.rint(self._u), 0, width - 1).astype(np.int64)
        return labels[rows, columns]


def read_camera_file(path: Path, width: int, height: int) -> Lens:
    """Read ``camera.json``; UserError if it is damaged, for pictures of another size than the given, or not possible."""
    try:
        entries = read_json(path)
        w, h, *pinhole = (float(entries[key]) for key in _KEYS)
        distortion = [float(entries.get(key, 0.0)) for key in _DISTORTION]
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise UserError(
            f"{path}: not an object with the numbers {', '.join(_KEYS)} ({repr(error)[:200]})."
        ) from error
    if other := [key for key in entries if key not in (*_KEYS, *_DISTORTION)]:
        keys = ", ".join((*_KEYS, *_DISTORTION))
        raise UserError(f"{path}: {', '.join(other)[:200]}: not read; it has {keys}.")
    if (w, h) != (width, height):
        raise UserError(f"{path}: for {w:g}x{h:g} px, but the upright frames are {width}x{height}.")
    return Lens("OPENCV", width, height, (*pinhole, *distortion)).check(str(path))
