"""Pictures ask for radial distortion where there is some, and hardly ever where there is none."""

import cv2
import numpy as np
import pycolmap
import pytest

from egosplat.calibration.colmap import distortion
from egosplat.calibration.colmap.distortion import choices, compare, lens_of_frames
from egosplat.calibration.lens import Lens
from egosplat.geometry import Camera
from tests.support.recordings import synthesized


def model_of(k1: float, k2: float, seed: int) -> pycolmap.Reconstruction:
    """Fifteen images of 512 x 384 px of 300 points, which fill the picture."""
    params = [1500.0, 256.0, 192.0, k1, k2]
    size = {"camera_width": 512, "camera_height": 384, "camera_model_id": pycolmap.CameraModelId.RADIAL}
    model = synthesized(seed, 15, 300, 0.5, camera_params=params, **size)
    for number in [number for number, point in model.points3D.items() if point.track.length() < 2]:
        model.delete_point3D(number)
    return model


@pytest.mark.parametrize("k1, k2", [(0.5, 0.0), (-1.0, 1.0), (0.5, -8.0)])
def test_a_lens_with_distortion_is_found(k1, k2, capfd):
    lens, evidence = compare(model_of(k1, k2, seed=0))
    assert capfd.readouterr() == ("", "")
    assert evidence["distorted"] and evidence["chance"] < distortion.FALSE_ALARM
    assert evidence["bend_px"] > evidence["median_px"] and evidence["radial_px"] < evidence["pinhole_px"]
    radius = 0.15  # three quarters of the way to the corners
    assert lens.params[3] + lens.params[4] * radius**2 == pytest.approx(k1 + k2 * radius**2, rel=0.2)


def test_a_pinhole_camera_is_left_alone():
    found = [compare(model_of(0.0, 0.0, seed))[1] for seed in range(10)]
    assert not any(one["distorted"] for one in found)
    assert all(one["radial_px"] <= one["pinhole_px"] + 1e-6 for one in found)


def test_frames_are_chosen_from_the_whole_recording_and_then_closer():
    chosen = list(choices(1000))
    assert [(len(one), int(np.diff(one)[0])) for one in chosen] == [(30, 34), (30, 4), (30, 1)]
    assert all(0 <= one.min() and one.max() < 1000 for one in chosen)
    (short,) = choices(distortion.MAX_PICTURES - 1)
    assert short.tolist() == list(range(distortion.MAX_PICTURES - 1))


def test_rendered_pictures_of_a_barrel_lens_are_rectified(room):
    lens = Lens("RADIAL", 240, 180, (210.0, 120.0, 90.0, -0.15, 0.0))
    columns, rows = np.meshgrid(np.arange(240) + 0.5, np.arange(180) + 0.5)
    rays = lens.colmap().cam_from_img(np.stack([columns, rows], -1).reshape(-1, 2)).reshape(180, 240, 2)
    source = (rays * 210.0 + [120.0, 90.0] - 0.5).astype(np.float32)
    about = source, None, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT
    images = [cv2.remap(image, *about) for image in room.images(room.walk(12))]
    valid = np.ones((180, 240), bool)
    found = lens_of_frames(lambda frames: (images[i] for i in frames), 12, valid, room.camera)
    assert found
    assert found.params[3] == pytest.approx(-0.15, abs=0.05)
    assert found.pinhole.fx == pytest.approx(lens.pinhole.fx, rel=0.05)


def test_without_a_model_a_pinhole_camera_is_taken_and_not_on_a_full_disk(capsys, monkeypatch):
    camera = Camera(64, 48, 77.0, 77.0, 32.0, 24.0)
    blank = [np.full((48, 64, 3), 90, np.uint8)] * 8
    valid = np.ones((48, 64), bool)
    assert lens_of_frames(lambda frames: (blank[i] for i in frames), 8, valid, camera) is None
    assert "taken as a pinhole camera, because" in capsys.readouterr().err
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("", (), {"free": 0}))
    with pytest.raises(OSError, match="0 MiB are free.*TMPDIR"):
        lens_of_frames(lambda frames: (blank[i] for i in frames), 8, valid, camera)
