"""Frames are turned upright by the device's calibration: gen1 by a quarter turn, gen2 not at all."""

import numpy as np
import pytest
from projectaria_tools.core import calibration as aria
from projectaria_tools.core.calibration import CameraCalibration, DeviceCalibration, DeviceVersion
from projectaria_tools.core.data_provider import VrsDataProvider
from projectaria_tools.core.sophus import SE3
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.frames.adt import open_recording, rectification
from egosplat.frames.adt_annotations import open_annotations
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.rectify import clockwise_turns, pinhole
from egosplat.geometry import make_pose

RGB = "camera-rgb"
BUILDS = [
    (DeviceVersion.Gen1, "DVT-L", "camera-slam-left", 1),
    (DeviceVersion.Gen1, "DVT-S", "camera-slam-left", 1),
    (DeviceVersion.Gen2, "DVT_LL", "slam-front-left", 0),
    (DeviceVersion.Gen2, "EVT_SS", "slam-front-left", 0),
]


def device(version: DeviceVersion, build: str, origin: str, tilt_deg: float = 0.0) -> DeviceCalibration:
    """A device as the library's own CAD has it, its RGB camera turned about its axis, read back from JSON as
    from a VRS. Pictures are 256 x 192 pixels: not square, as gen2's."""
    cad = aria.DeviceCadExtrinsics(version, build, origin)
    empty = DeviceCalibration({}, {}, {}, {}, {}, cad, build, origin, version)
    turn = Rotation.from_euler("z", tilt_deg, degrees=True).as_matrix()
    tilt = SE3.from_matrix(make_pose(turn, np.zeros(3)))
    cpf = empty.get_transform_device_cpf(aria.CpfType.CadBased)
    mounted = cpf @ empty.get_transform_cpf_sensor(RGB, True) @ tilt
    lens = aria.CameraModelType.FISHEYE624, np.array([120.0, 127.5, 95.5, *[0.0] * 12])
    cameras = {
        name: CameraCalibration(name, *lens, pose, 256, 192, None, 1.0, "test")
        for name, pose in ((RGB, mounted), (origin, SE3()))
    }
    made = DeviceCalibration(cameras, {}, {}, {}, {}, cad, build, origin, version)
    return aria.device_calibration_from_json_string(aria.device_calibration_to_json_string(made))


@pytest.mark.parametrize("version, build, origin, turns", BUILDS)
def test_up_in_the_frame_is_up_of_the_wearer(version, build, origin, turns, tmp_path):
    calibration = device(version, build, origin)
    made = rectification(calibration, pinhole(64), True, tmp_path)
    cpf_from_device = np.linalg.inv(calibration.get_transform_device_cpf(aria.CpfType.CadBased).to_matrix())
    up = -(cpf_from_device @ made.device_from_camera)[:3, 1]
    assert up[1] > 0.98
    sensor = rectification(calibration, pinhole(64), False, tmp_path)
    image = np.random.default_rng(0).integers(256, size=(192, 256, 3), dtype=np.uint8)
    assert (made.color(image) == np.rot90(sensor.color(image), -turns)).all()
    assert (made.valid == np.rot90(sensor.valid, -turns)).all()


def test_every_quarter_turn_is_found():
    for turns in range(4):
        for tilt in (-40, 0, 40):
            turned = device(*BUILDS[2][:3], tilt_deg=90 * turns + tilt)
            assert clockwise_turns(turned, RGB) == turns


@pytest.mark.parametrize(
    "version, expected", [(DeviceVersion.Gen1, 1), (DeviceVersion.Gen2, 0), (DeviceVersion.NotValid, None)]
)
def test_a_calibration_without_cad_uses_the_device_generation(version, expected, tmp_path):
    camera = device(*BUILDS[0][:3]).get_camera_calib(RGB)
    unknown = DeviceCalibration({RGB: camera}, device_version=version)
    assert clockwise_turns(unknown, RGB) == expected
    if expected is None:
        with pytest.raises(UserError, match="frames.upright=false"):
            rectification(unknown, pinhole(64), True, tmp_path / "video.vrs")
        assert (rectification(unknown, pinhole(64), False, tmp_path).valid).any()


OPTIONS = FramesOptions(resolution=64)


def test_a_gen2_recording_is_not_turned(sample, monkeypatch):
    """The sample's frames with the mounting of gen2: as the sensor takes them, whatever frames.upright says."""
    lying = open_recording(sample, OPTIONS.change(upright=False))
    assert not lying.upright

    calibration = VrsDataProvider.get_device_calibration

    def gen2(provider):
        lens = calibration(provider).get_camera_calib(RGB)
        version, build, origin, _ = BUILDS[2]
        pose = device(version, build, origin).get_camera_calib(RGB).get_transform_device_camera()
        size, radius = map(int, lens.get_image_size()), lens.get_valid_radius()
        about = lens.get_projection_params(), pose, *size, radius, lens.get_max_solid_angle(), "test"
        camera = CameraCalibration(RGB, aria.CameraModelType.FISHEYE624, *about)
        cad = aria.DeviceCadExtrinsics(version, build, origin)
        return DeviceCalibration({RGB: camera}, {}, {}, {}, {}, cad, build, origin, version)

    monkeypatch.setattr(VrsDataProvider, "get_device_calibration", gen2)
    for upright in (True, False):
        turned = open_recording(sample, OPTIONS.change(upright=upright))
        assert turned.upright
        image = next(turned.read_frames(np.array([0])))
        assert (image == next(lying.read_frames(np.array([0])))).all()
    keys = [AnnotationKeys(lying.camera, upright) for upright in (True, False)]
    time = int(lying.timestamp_ns[0])
    turned, sensor = (open_annotations(sample, each).read(time) for each in keys)
    assert (turned == sensor).all()
