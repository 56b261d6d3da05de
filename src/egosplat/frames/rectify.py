"""Rectify Aria's fisheye images, as EgoLifter's preprocessing of ADT does (docs/method.md#rectification)."""

import cv2
import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core.calibration import (
    CameraCalibration,
    CpfType,
    DeviceCalibration,
    DeviceVersion,
    distort_by_calibration,
    distort_label_by_calibration,
    get_linear_camera_calibration,
)

from egosplat.geometry import CLOCKWISE, Camera

# Side of ADT's images [px]; ``frames.focal`` is given for this size.
FOCAL_SIDE = 1408

# Far enough outside the source that bilinear sampling gives 0.
_OUTSIDE = -10.0

# Clockwise quarter turns of devices whose build the library has no CAD of: gen1 mounts the RGB sensor sideways.
_TURNS = {DeviceVersion.Gen1: 1, DeviceVersion.Gen2: 0}


def pinhole(resolution: int, focal: float) -> Camera:
    """A square camera with a central principal point; its focal length is given for ``FOCAL_SIDE`` px (the paper: 460)."""
    scaled = focal * resolution / FOCAL_SIDE
    return Camera(resolution, resolution, scaled, scaled, resolution / 2, resolution / 2)


def clockwise_turns(device: DeviceCalibration, label: str) -> int | None:
    """Clockwise quarter turns, 0 to 3, that bring images of camera ``label`` upright; None of an unknown device."""
    if device.get_transform_cpf_sensor(label, True) is not None:
        cpf_from_device = device.get_transform_device_cpf(CpfType.CadBased).to_matrix().T[:3, :3]
        device_from_camera = device.get_camera_calib(label).get_transform_device_camera().to_matrix()[:3, :3]
        return turns_from_rotation(cpf_from_device @ device_from_camera)
    return _TURNS.get(device.get_device_version())


def turns_from_rotation(cpf_from_camera: NDArray[np.float64]) -> int:
    """Clockwise quarter turns, 0 to 3, that bring up in the image closest to up in the central pupil frame (CPF).

    Args:
        cpf_from_camera: (3, 3) rotation. CPF: x to the wearer's left, y up, z ahead. Camera: OpenCV's axes.
    """
    # The y axis of CPF in camera axes; the image turns so that it points up.
    right, down, _ = cpf_from_camera[1]
    return round(np.arctan2(-right, -down) / (np.pi / 2)) % 4


class Rectification:
    """Maps images and label maps of one fisheye camera to one pinhole camera.

    Attributes:
        camera: the pinhole camera. It is square and centered, so turning the image does not change it.
        device_from_camera: (4, 4) float64 pose of the pinhole camera in the device frame.
        valid: (H, W) bool: pixels whose whole area lies inside the lens circle and the fisheye image.
    """

    def __init__(self, calibration: CameraCalibration, camera: Camera, turns: int) -> None:
        """Compute the sampling positions of ``camera``, from ``pinhole``; the result is turned, see ``clockwise_turns``."""
        if camera != camera.rotated_clockwise():
            raise ValueError("Aria images are rectified to a square camera with a central principal point")
        self.camera = camera
        self.device_from_camera = calibration.get_transform_device_camera().to_matrix()
        for _ in range(turns):
            self.device_from_camera = self.device_from_camera @ CLOCKWISE
        width, height = calibration.get_image_size()
        self._turns, self._source_shape = turns, (int(height), int(width))
        self._factor = factor = supersampling(calibration, camera)
        # projectaria-tools computes once where each pinhole pixel lies in the fisheye image, and OpenCV samples every
        # image there: several times as fast as ``distort_by_calibration``, and equal within one gray level.
        fine = linear_calibration(camera.scaled_to(camera.width * factor, camera.height * factor))
        # Rectifying the column and row numbers gives all positions in one call: bilinear interpolation of a linear
        # function is exact. Pixel centers are at integers, as in OpenCV.
        rows, columns = np.mgrid[: self._source_shape[0], : self._source_shape[1]].astype(np.float32)
        inside = distort_by_calibration(np.ones_like(rows), fine, calibration) > 0.5
        # The library returns 0 outside, which is also a valid column and row.
        self._map_u, self._map_v = (
            np.where(inside, distort_by_calibration(numbers, fine, calibration), np.float32(_OUTSIDE))
            for numbers in (columns, rows)
        )
        samples = inside.reshape(camera.height, factor, camera.width, factor)
        self.valid = self._turn(samples.all(axis=(1, 3)))
        # The flat index of the source pixel nearest to each target pixel's center; 0 where there is none.
        numbered = np.arange(rows.size, dtype=np.uint64).reshape(rows.shape)
        nearest = distort_label_by_calibration(numbered, linear_calibration(camera), calibration)
        self._source_index = self._turn(nearest.astype(np.int64))

    def color(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 fisheye image -> (H, W, 3) uint8 pinhole image, 0 where not ``valid``; ValueError for another size."""
        self._check_shape(image)
        fine = cv2.remap(image, self._map_u, self._map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        # Bilinear sampling reads only four source pixels, so a small image would alias: average finer samples.
        if self._factor > 1:
            size = (self.camera.width, self.camera.height)
            fine = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        turned = self._turn(fine)
        turned[~self.valid] = 0
        return turned

    def labels(self, labels: NDArray[np.generic]) -> NDArray[np.generic]:
        """(h, w) fisheye labels of any dtype -> (H, W) labels by nearest neighbor, 0 where not ``valid``; ValueError as ``color``."""
        self._check_shape(labels)
        # Labels cannot be averaged, so each pixel takes the label at its center.
        sampled = labels.reshape(-1)[self._source_index]
        sampled[~self.valid] = 0
        return sampled

    def _turn(self, image: NDArray) -> NDArray:
        return np.ascontiguousarray(np.rot90(image, -self._turns)) if self._turns else image

    def _check_shape(self, image: NDArray) -> None:
        if image.shape[:2] != self._source_shape:
            raise ValueError(f"image of {image.shape[:2]} pixels, calibration for {self._source_shape}")


def supersampling(calibration: CameraCalibration, camera: Camera) -> int:
    """Samples per pixel side, so that samples lie at most 1.5 source pixels apart."""
    # A pinhole image is coarsest in the middle: there one pixel spans this many source pixels.
    step = float(np.max(calibration.get_focal_lengths())) / camera.fx
    # Rounding gives one sample for the paper's case, 1408 px at focal length 460.
    return max(1, round(step))


def linear_calibration(camera: Camera, label: str = "") -> CameraCalibration:
    """A ``pinhole`` camera as projectaria-tools represents it (principal point at ``(side - 1) / 2``)."""
    return get_linear_camera_calibration(camera.width, camera.height, camera.fx, label)
