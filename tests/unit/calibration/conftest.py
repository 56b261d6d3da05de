"""A small scene with known poses, written as a COLMAP model and as a ``transforms.json``."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from tests.support.recordings import synthesized

WIDTH, HEIGHT = 64, 48
NAMES = [f"{number}.png" for number in range(1, 7)]


def synthetic_model() -> pycolmap.Reconstruction:
    """Six pictures ``1.png`` to ``6.png`` of one camera with radial distortion, and thirty points."""
    camera = {"camera_width": WIDTH, "camera_height": HEIGHT, "camera_params": [60.0, 31, 25, 0.05, -0.01]}
    model = synthesized(3, 6, 30, camera_model_id=pycolmap.CameraModelId.RADIAL, **camera)
    for image, name in zip(sorted(model.images.values(), key=lambda one: one.image_id), NAMES, strict=True):
        image.name = name
    return model


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
def transforms(pictures: Path, model: pycolmap.Reconstruction) -> Callable[..., Path]:
    """Write a ``transforms.json`` beside the pictures as nerfstudio does, with changed keys; None drops a key."""
    frames = []
    for image in sorted(model.images.values(), key=lambda image: image.name):
        pose = np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) * [1, -1, -1, 1]
        frames.append({"file_path": f"images/{image.name}", "transform_matrix": pose.tolist()})

    def write(**changes: Any) -> Path:
        camera = {"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": 60.0, "fl_y": 60.0, "cx": 31.0}
        camera |= {"cy": 25.0, "k1": 0.05, "k2": -0.01, "p1": 0.0, "p2": 0.0}
        document = camera | {"frames": frames} | changes
        document = {key: value for key, value in document.items() if value is not None}
        (path := pictures / "transforms.json").write_text(json.dumps(document))
        return path

    return write
