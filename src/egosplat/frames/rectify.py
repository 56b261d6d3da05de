"""Rectify Aria's fisheye images, as EgoLifter's preprocessing of ADT does (docs/method.md#rectification)."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core import calibration as aria

from egosplat.geometry import CLOCKWISE, Camera

# Focal length of rectified frames in units of their side: the paper's 460 of 1408 px, a field of view of 113.7 degrees.
_FOCAL = 460 / 1408

# Far enough outside the source that bilinear sampling gives 0.
_OUTSIDE = np.float32(-10.0)

# Clockwise quarter turns of devices whose build the library has no CAD of: gen1 mounts the RGB sensor sideways.
_TURNS = {aria.DeviceVersion.Gen1: 1, aria.DeviceVersion.Gen2: 0}


def pinhole(resolution: int) -> Camera:
    """The square camera of rectified frames, with a central principal point."""
    focal, middle = _FOCAL * resolution, resolution / 2
    return Camera(resolution, resolution, focal, focal, middle, middle)


def clockwise_turns(device: aria.DeviceCalibration, label: str) -> int | None:
    """Clockwise quarter turns, 0 to 3, that bring images of camera ``label`` upright; None of an unknown device."""
    if device.get_transform_cpf_sensor(label, True) is None:
        return _TURNS.get(device.get_device_version())
    camera = device.get_camera_calib(label)
    assert camera is not None
    # The y axis, up, of the central pupil frame (CPF) in OpenCV's axes of the camera; the image turns so that it points up.
    device_from_cpf = device.get_transform_device_cpf(aria.CpfType.CadBased).to_matrix()
    up = device_from_cpf[:3, 1] @ camera.get_transform_device_camera().to_matrix()[:3, :3]
    return round(np.arctan2(-up[0], -up[1]) / (np.pi / 2)) % 4


class Rectification:
    """Maps images and label maps of one fisheye camera to one pinhole camera.

    Attributes:
        camera: the pinhole camera. It is square and centered, so turning the image does not change it.
        device_from_camera: (4, 4) float64 pose of the pinhole camera in the device frame.
        valid: (H, W) bool: pixels whose whole area lies inside the lens circle and the fisheye image.
    """

    def __init__(self, calibration: aria.CameraCalibration, camera: Camera, turns: int) -> None:
        """Compute the sampling positions of ``camera``, from ``pinhole``; the result is turned, see ``clockwise_turns``."""
        self.camera, self._turns = camera, turns
        self.device_from_camera = calibration.get_transform_device_camera().to_matrix()
        for _ in range(turns):
            self.device_from_camera = self.device_from_camera @ CLOCKWISE
        width, height = map(int, calibration.get_image_size())
        self._source_shape, self._factor = (height, width), supersampling(calibration, camera)
        # projectaria-tools computes once where each pinhole pixel lies in the fisheye image, and OpenCV samples every
        # image there: several times as fast as ``distort_by_calibration``, and equal within one gray level.
        side = camera.width * self._factor
        fine = linear_calibration(camera.scaled_to(side, side))
        # Rectifying the column and row numbers gives all positions in one call: bilinear interpolation of a linear
        # function is exact. Pixel centers are at integers, as in OpenCV.
        rows, columns = np.mgrid[:height, :width].astype(np.float32)
        inside = aria.distort_by_calibration(np.ones_like(rows), fine, calibration) > 0.5
        # The library returns 0 outside, which is also a valid column and row.
        self._map_u, self._map_v = (
            np.where(inside, aria.distort_by_calibration(numbers, fine, calibration), _OUTSIDE)
            for numbers in (columns, rows)
        )
        samples = inside.reshape(camera.height, self._factor, camera.width, self._factor)
        self.valid: NDArray[np.bool_] = self._turn(np.all(samples, axis=(1, 3)))
        # The flat index of the source pixel nearest to each target pixel's center; 0 where there is none.
        numbered = np.arange(rows.size, dtype=np.uint64).reshape(rows.shape)
        nearest = aria.distort_label_by_calibration(numbered, linear_calibration(camera), calibration)
        self._source_index = self._turn(nearest.astype(np.int64))

    def color(self, image: NDArray[Any]) -> NDArray[Any]:
        """(h, w, 3) uint8 fisheye image -> (H, W, 3) uint8 pinhole image, 0 where not ``valid``; ValueError for another size."""
        self._check_shape(image)
        fine = cv2.remap(image, self._map_u, self._map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        # Bilinear sampling reads only four source pixels, so a small image would alias: average finer samples.
        if self._factor > 1:
            fine = cv2.resize(fine, self.valid.shape[::-1], interpolation=cv2.INTER_AREA)
        turned = self._turn(fine)
        turned[~self.valid] = 0
        return turned

    def labels(self, labels: NDArray[Any]) -> NDArray[Any]:
        """(h, w) fisheye labels of any dtype -> (H, W) labels by nearest neighbor, 0 where not ``valid``; ValueError as ``color``."""
        self._check_shape(labels)
        # Labels cannot be averaged, so each pixel takes the label at its center.
        sampled = labels.reshape(-1)[self._source_index]
        sampled[~self.valid] = 0
        return sampled

    def _turn(self, image: NDArray[Any]) -> NDArray[Any]:
        return np.ascontiguousarray(np.rot90(image, -self._turns))

    def _check_shape(self, image: NDArray[Any]) -> None:
        if image.shape[:2] != self._source_shape:
            raise ValueError(
                f"{image.shape[:2]} px, of a calibration for {self._source_shape}: is it of video.vrs?"
            )


def supersampling(calibration: aria.CameraCalibration, camera: Camera) -> int:
    """Samples per pixel side, so that samples lie at most 1.5 source pixels apart; in the middle a pinhole image is coarsest."""
    return max(1, round(float(np.max(calibration.get_focal_lengths())) / camera.fx))


def linear_calibration(camera: Camera) -> aria.CameraCalibration:
    """A ``pinhole`` camera as projectaria-tools represents it (principal point at ``(side - 1) / 2``)."""
    return aria.get_linear_camera_calibration(camera.width, camera.height, camera.fx, "")
