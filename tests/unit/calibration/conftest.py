"""A small scene with known poses, written as a COLMAP model and as a ``transforms.json``."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

WIDTH, HEIGHT = 64, 48
NAMES = [f"{number}.png" for number in range(1, 7)]


def synthetic_model() -> pycolmap.Reconstruction:
    """Six pictures ``1.png`` to ``6.png`` of one camera with radial distortion, and thirty points."""
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1,
        num_cameras_per_rig=1,
        num_frames_per_rig=6,
        num_points3D=30,
        camera_model_id=pycolmap.CameraModelId.RADIAL,
        camera_width=WIDTH,
        camera_height=HEIGHT,
        camera_params=[60.0, 31.0, 25.0, 0.05, -0.01],
    )
    pycolmap.set_random_seed(3)
    model = pycolmap.synthesize_dataset(options)
    for image, name in zip(sorted(model.images.values(), key=lambda one: one.image_id), NAMES, strict=True):
        image.name = name
    return model


def opengl_frames(model: pycolmap.Reconstruction) -> list[dict[str, Any]]:
    """The frames of a ``transforms.json``, as nerfstudio writes them."""
    frames = []
    for image in sorted(model.images.values(), key=lambda one: one.name):
        matrix = np.eye(4)
        matrix[:3] = image.cam_from_world().inverse().matrix()
        matrix[:, 1:3] *= -1
        frames.append({"file_path": f"images/{image.name}", "transform_matrix": matrix.tolist()})
    return frames


@pytest.fixture
def model() -> pycolmap.Reconstruction:
    return synthetic_model()


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """A folder with the six pictures."""
    (folder := tmp_path / "pictures").mkdir()
    for number, name in enumerate(NAMES):
        Image.new("RGB", (WIDTH, HEIGHT), (40 * number, 90, 0)).save(folder / name)
    return folder


@pytest.fixture
def colmap_folder(pictures: Path, model: pycolmap.Reconstruction) -> Path:
    """The model as .bin files beside the pictures."""
    (folder := pictures / "colmap").mkdir()
    model.write_binary(folder)
    return folder


@pytest.fixture
def text_folder(pictures: Path, model: pycolmap.Reconstruction) -> Path:
    """The model as .txt files beside the pictures."""
    (folder := pictures / "colmap").mkdir()
    model.write_text(folder)
    return folder


@pytest.fixture
def transforms(pictures: Path, model: pycolmap.Reconstruction) -> Callable[..., Path]:
    """Write a ``transforms.json`` beside the pictures, with changed keys; None drops a key."""

    def write(**changes: Any) -> Path:
        camera = {"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": 60.0, "fl_y": 60.0, "cx": 31.0}
        camera |= {"cy": 25.0, "k1": 0.05, "k2": -0.01, "p1": 0.0, "p2": 0.0}
        document = camera | {"frames": opengl_frames(model)} | changes
        document = {key: value for key, value in document.items() if value is not None}
        (path := pictures / "transforms.json").write_text(json.dumps(document))
        return path

    return write
