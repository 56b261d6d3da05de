"""Small recordings for the tests of frames."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from projectaria_tools.core.calibration import CameraCalibration, CameraModelType
from projectaria_tools.core.sophus import SE3

from egosplat.frames.adt import open_recording
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording

FISHEYE624 = [
    610.941, 715.115, 716.715,
    0.406036, -0.489948, 0.174565, 1.13298, -1.70164, 0.651156,
    0.000621147, 1.9322e-05, -1.48553e-05, 0.000260123, -0.000658211, 3.7614e-05,
]  # fmt: skip
"""A real Aria RGB camera: focal length, principal point, radial, tangential and thin-prism terms."""


@pytest.fixture(scope="session")
def fisheye() -> CameraCalibration:
    """The calibration of a real Aria RGB camera, rescaled from 1408 to 352 px."""
    axis, place = np.array([0.32414, 0.0402123, 0.0410768]), np.array([-0.00428072, -0.0118417, -0.00511398])
    pose = SE3.from_quat_and_translation(0.944261, axis, place)[0]
    lens = CameraModelType.FISHEYE624, np.array(FISHEYE624)
    full = CameraCalibration("camera-rgb", *lens, pose, 1408, 1408, 707.5, 1.0, "")
    return full.rescale(np.array([352, 352]), 0.25)


def write_video(path: Path, frames: list[NDArray[np.uint8]], fps: float = 15.0) -> Path:
    """Write (H, W, 3) RGB frames as an mp4."""
    height, width = frames[0].shape[:2]
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), fps, (width, height))
    assert writer.isOpened()
    for image in frames:
        writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    writer.release()
    return path


def grey_frames(count: int, width: int = 64, height: int = 48) -> list[NDArray[np.uint8]]:
    """Pictures whose grey value is 10 times their number (modulo 250); the left half is redder."""
    frames = [np.full((height, width, 3), 10 * number % 250, dtype=np.uint8) for number in range(count)]
    for image in frames:
        image[:, : width // 2, 0] = 250
    return frames


@pytest.fixture
def video(tmp_path: Path) -> Callable[..., Path]:
    """Write a video of ``count`` frames, 15 a second: ``video(name, count, fps)``."""

    def write(name: str = "clip.mp4", count: int = 12, fps: float = 15.0) -> Path:
        return write_video(tmp_path / name, grey_frames(count), fps)

    return write


@pytest.fixture(scope="session")
def sample(real_data: Callable[[str], Path]) -> Path:
    """A real Aria Digital Twin recording of three frames."""
    return real_data("adt_sample")


@pytest.fixture(scope="session")
def full_size(sample: Path) -> Recording:
    """It, in the size of its pictures."""
    return open_recording(sample, FramesOptions(resolution=1408, upright=True))


@pytest.fixture
def copy(sample: Path, tmp_path: Path) -> Path:
    """A copy of the recording, what the readers use of it, that a test may damage."""
    folder = tmp_path / "sequence"
    folder.mkdir()
    videos = ("video.vrs", "segmentations_with_skeleton.vrs", "segmentations.vrs")
    for name in (*videos, "instances.json", "metadata.json"):
        shutil.copyfile(sample / name, folder / name)
    return folder
