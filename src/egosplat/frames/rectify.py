"""Rectification of Aria's fisheye pictures, as in EgoLifter's preprocessing of ADT (docs/method.md#rectification).

projectaria-tools computes where each pinhole pixel lies in the fisheye picture, once a recording; OpenCV
then samples each picture there, which is as accurate as the library's own ``distort_by_calibration``
(within one grey level: that one cuts fractions off, this one rounds) and several times as fast.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core.calibration import (
    CameraCalibration,
    distort_by_calibration,
    distort_label_by_calibration,
    get_linear_camera_calibration,
)

from egosplat.errors import UserError
from egosplat.geometry import CLOCKWISE, Camera

FOCAL_SIDE = 1408
"""Side [px] of the picture for which a focal length is given, ADT's own; smaller pictures scale it."""

_OUTSIDE = -10.0
"""A source coordinate far enough outside that bilinear sampling there gives 0."""


def pinhole(resolution: int, focal: float) -> Camera:
    """The square pinhole camera whose principal point is the middle of the image.

    Args:
        resolution: side of the image [px].
        focal: focal length [px] that the image would have at ``FOCAL_SIDE`` (the paper: 460).

    Raises:
        UserError: an option is out of its range.
    """
    if resolution < 1:
        raise UserError(f"resolution: {resolution} is not a positive number of pixels.")
    if not (math.isfinite(focal) and focal > 0):
        raise UserError(
            f"focal: {focal} is not a positive number of pixels (at {FOCAL_SIDE} px; the paper: 460)."
        )
    scaled = focal * resolution / FOCAL_SIDE
    return Camera(resolution, resolution, scaled, scaled, resolution / 2, resolution / 2)


class Rectification:
    """Everything that takes one fisheye camera's pictures and labels to one pinhole camera.

    Attributes:
        camera: the pinhole camera; the same in sensor orientation and upright, being square and centred.
        device_from_camera: (4, 4) float64 pose of the pinhole camera in the device frame.
        valid: (H, W) bool: pixels whose whole area lies inside the lens circle and the fisheye picture.
    """

    def __init__(self, calibration: CameraCalibration, camera: Camera, turns: int) -> None:
        """Prepare the sampling.

        Args:
            calibration: of the fisheye pictures.
            camera: from ``pinhole``.
            turns: clockwise quarter turns of the result, see ``upright.clockwise_turns``.
        """
        if camera != camera.rotated_clockwise():
            raise ValueError("Aria pictures are rectified to a square camera with a central principal point")
        self.camera = camera
        self.device_from_camera = calibration.get_transform_device_camera().to_matrix()
        for _ in range(turns):
            self.device_from_camera = self.device_from_camera @ CLOCKWISE
        self._turns = turns
        self._factor = supersampling(calibration, camera)
        self._map_u, self._map_v, inside = _source_coordinates(calibration, camera, self._factor)
        self.valid = self._turn(_shrink_mask(inside, self._factor))
        self._source_index = self._turn(_nearest_source(calibration, camera))
        self._source_shape = _source_shape(calibration)

    def colour(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 fisheye picture -> (H, W, 3) uint8 pinhole picture, 0 where not ``valid``.

        Bilinear sampling reads four source pixels however far apart two target pixels lie, so a small
        picture would alias. It is therefore sampled ``supersampling`` times as finely and averaged over
        each pixel's area.

        Raises:
            ValueError: the picture has another size than the calibration.
        """
        self._check_shape(picture)
        fine = cv2.remap(picture, self._map_u, self._map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        if self._factor > 1:
            size = (self.camera.width, self.camera.height)
            fine = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        turned = self._turn(fine)
        turned[~self.valid] = 0
        return turned

    def labels(self, picture: NDArray[np.generic]) -> NDArray[np.generic]:
        """(h, w) fisheye labels of any type -> (H, W) labels by nearest neighbour, 0 where not ``valid``.

        Raises:
            ValueError: the picture has another size than the calibration.
        """
        self._check_shape(picture)
        sampled = picture.reshape(-1)[self._source_index]
        sampled[~self.valid] = 0
        return sampled

    def _turn(self, image: NDArray) -> NDArray:
        return np.ascontiguousarray(np.rot90(image, -self._turns)) if self._turns else image

    def _check_shape(self, picture: NDArray) -> None:
        if picture.shape[:2] != self._source_shape:
            raise ValueError(f"picture of {picture.shape[:2]} pixels, calibration for {self._source_shape}")


def supersampling(calibration: CameraCalibration, camera: Camera) -> int:
    """How many samples a pixel's side needs so that they lie at most 1.5 source pixels apart.

    In the middle, where a pinhole picture is coarsest, a step of one pixel is ``source focal / focal``
    source pixels. Rounding keeps the paper's own case, 1408 px at focal length 460, at a single sample.
    """
    step = float(np.max(calibration.get_focal_lengths())) / camera.fx
    return max(1, round(step))


def linear_calibration(camera: Camera, label: str = "") -> CameraCalibration:
    """projectaria-tools' form of a ``pinhole`` camera (its principal point is at ``(side - 1) / 2``)."""
    return get_linear_camera_calibration(camera.width, camera.height, camera.fx, label)


def _source_coordinates(
    calibration: CameraCalibration, camera: Camera, factor: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Where each sample lies in the source (pixel centre at the integer, as OpenCV has it), and whether.

    Rectifying pictures of the source's own column and row numbers gives them for all pixels in one call:
    bilinear interpolation of a linear function is exact. The library rejects what is outside the valid
    radius or has no four source neighbours.
    """
    fine = linear_calibration(camera.scaled_to(camera.width * factor, camera.height * factor))
    height, width = _source_shape(calibration)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    inside = distort_by_calibration(np.ones_like(rows), fine, calibration) > 0.5
    # The library marks what is outside with 0, which is a column and a row of the source.
    map_u = np.where(inside, distort_by_calibration(columns, fine, calibration), np.float32(_OUTSIDE))
    map_v = np.where(inside, distort_by_calibration(rows, fine, calibration), np.float32(_OUTSIDE))
    return map_u, map_v, inside


def _nearest_source(calibration: CameraCalibration, camera: Camera) -> NDArray[np.int64]:
    """(H, W) flat index of the source pixel nearest to each target pixel's centre; 0 where there is none."""
    height, width = _source_shape(calibration)
    index = np.arange(height * width, dtype=np.uint64).reshape(height, width)
    return distort_label_by_calibration(index, linear_calibration(camera), calibration).astype(np.int64)


def _source_shape(calibration: CameraCalibration) -> tuple[int, int]:
    width, height = calibration.get_image_size()
    return int(height), int(width)


def _shrink_mask(mask: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """A coarse pixel is in the mask if all of its ``factor`` x ``factor`` samples are."""
    height, width = mask.shape[0] // factor, mask.shape[1] // factor
    return mask.reshape(height, factor, width, factor).all(axis=(1, 3))
