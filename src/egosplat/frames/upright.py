"""How an Aria's pictures are turned upright, decided by the device's own calibration.

The RGB sensor of gen1 is mounted a quarter turn off, that of gen2 is not. The calibration tells: where up in the central
pupil frame (CPF: x to the wearer's left, y up, z ahead) points in the picture.
"""

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core.calibration import CpfType, DeviceCalibration, DeviceVersion

_TURNS = {DeviceVersion.Gen1: 1, DeviceVersion.Gen2: 0}
"""Clockwise quarter turns by device, where the library has no CAD of its build and so no CPF."""


def clockwise_turns(device: DeviceCalibration, label: str) -> int | None:
    """Clockwise quarter turns that bring the pictures of camera ``label`` upright.

    Args:
        device: the calibration of the whole device, with that camera.
        label: of the camera.

    Returns:
        0 to 3; None where the calibration is of no device that is known.
    """
    if device.get_transform_cpf_sensor(label, True) is not None:
        cpf_from_device = device.get_transform_device_cpf(CpfType.CadBased).to_matrix().T[:3, :3]
        device_from_camera = device.get_camera_calib(label).get_transform_device_camera().to_matrix()[:3, :3]
        return turns_of(cpf_from_device @ device_from_camera)
    return _TURNS.get(device.get_device_version())


def turns_of(cpf_from_camera: NDArray[np.float64]) -> int:
    """The clockwise quarter turns, 0 to 3, after which up in the CPF is nearest to up in the picture.

    Args:
        cpf_from_camera: (3, 3) rotation; the camera's axes are OpenCV's (x right, y down in the picture).
    """
    right, down, _ = cpf_from_camera[1]
    return round(np.arctan2(-right, -down) / (np.pi / 2)) % 4
