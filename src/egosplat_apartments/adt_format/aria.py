"""The calibration of the synthetic device: invented, close to an Aria's, equal for every recording.

Only the RGB camera records. The left SLAM camera is included because its frame is the device frame.
"""

import json

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core.calibration import (
    CameraCalibration,
    CameraModelType,
    DeviceCadExtrinsics,
    DeviceCalibration,
    DeviceVersion,
    device_calibration_to_json_string,
)
from projectaria_tools.core.sophus import SE3
from scipy.spatial.transform import Rotation

from egosplat.geometry import make_pose

DEVICE_SERIAL = "SYNTHETIC"
RGB_LABEL = "camera-rgb"

_FULL_SIZE = 1408
_ORIGIN_LABEL = "camera-slam-left"
# The larger Aria frame, whose CAD places the eyes (central pupil frame) relative to the device frame.
_BUILD = "DVT-L"

# FISHEYE624: f, cx, cy [px], k0..k5 (radial), p0, p1 (tangential), s0..s3 (thin prism).
_RGB_PARAMETERS = np.array(
    [611.0, 714.0, 716.0, 0.4, -0.48, 0.17, 1.12, -1.68, 0.64, 6e-4, 2e-5, -1e-5, 2.5e-4, -6.5e-4, 4e-5]
)
_RGB_VALID_RADIUS_PX = 707.0
_RGB_MAX_ANGLE_RAD = 1.0
_RGB_ROTATION_VECTOR = (0.66, 0.08, 0.08)
_RGB_TRANSLATION_M = (-0.004, -0.012, -0.005)

_SLAM_SIZE = (640, 480)
_SLAM_PARAMETERS = np.array([241.0, 317.0, 237.5, -0.025, 0.098, -0.067, 0.0095, 0.0022, -5.5e-4, *[0.0] * 6])
_SLAM_VALID_RADIUS_PX = 330.0
_SLAM_MAX_ANGLE_RAD = 1.4


def device_from_camera() -> NDArray[np.float64]:
    """(4, 4) float64 pose of the RGB camera (OpenCV axes, sensor orientation) in the device frame [m].

    The sensor is mounted with a quarter turn: rotate the image clockwise by 90° to see it upright.
    """
    return make_pose(
        Rotation.from_rotvec(_RGB_ROTATION_VECTOR).as_matrix(), np.array(_RGB_TRANSLATION_M, dtype=np.float64)
    )


def camera_calibration(size: int) -> CameraCalibration:
    """Calibration of the RGB camera for square images of ``size`` pixels.

    The lens is opaque beyond ``get_valid_radius()`` [px] around the principal point.
    """
    pose, limits = SE3.from_matrix(device_from_camera()), (_RGB_VALID_RADIUS_PX, _RGB_MAX_ANGLE_RAD)
    full = _calibration(RGB_LABEL, _RGB_PARAMETERS, pose, (_FULL_SIZE, _FULL_SIZE), limits)
    # The library's own scaling: it puts pixel centers at integers, but keeps the field of view.
    return full.rescale(np.array([size, size], dtype=np.int32), size / _FULL_SIZE)


def _calibration(
    label: str, parameters: NDArray[np.float64], pose: SE3, size: tuple[int, int], limits: tuple[float, float]
) -> CameraCalibration:
    """A fisheye camera, given its valid radius [px] and largest angle [rad]."""
    model = CameraModelType.FISHEYE624
    return CameraCalibration(label, model, parameters, pose, *size, *limits, DEVICE_SERIAL)


def calibration_json(size: int) -> str:
    """Calibration of the whole device, with a square RGB camera of ``size`` pixels, as a VRS file carries it."""
    limits = (_SLAM_VALID_RADIUS_PX, _SLAM_MAX_ANGLE_RAD)
    slam = _calibration(_ORIGIN_LABEL, _SLAM_PARAMETERS, SE3(), _SLAM_SIZE, limits)
    device = DeviceCalibration(
        camera_calibs={RGB_LABEL: camera_calibration(size), _ORIGIN_LABEL: slam},
        device_cad_extrinsics=DeviceCadExtrinsics(DeviceVersion.Gen1, _BUILD, _ORIGIN_LABEL),
        device_subtype=_BUILD,
        origin_label=_ORIGIN_LABEL,
        device_version=DeviceVersion.Gen1,
    )
    # The library's writer is needed for each camera's ConfigData (image size, valid radius, largest angle).
    # Without it the reader assumes the 2880-pixel sensor, which it reduces to 1408 and 704 pixels only.
    document = json.loads(device_calibration_to_json_string(device))
    document |= {
        "AlgorithmName": "egosplat.synthetic",
        "AlgorithmVersion": "1",
        "CalibrationSource": "Synthetic",
        "Serial": DEVICE_SERIAL,
    }
    return json.dumps(document, sort_keys=True)
