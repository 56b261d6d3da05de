"""Gaussians that another program trained, in the workflow."""

import json

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SPLATS
from egosplat.geometry import Camera
from tests.support.gaussian_scene import opaque, photographs
from tests.support.scenes import sideways
from tests.support.splat_files import gsplat_columns, ply, write

CAMERA = Camera(96, 96, 88.0, 88.0, 48.0, 48.0)
SCENE = "results/mine/scene"


@pytest.fixture
def splat(tmp_path):
    """A file of Gaussians beside the nerfstudio folder that they were trained on."""
    random = np.random.default_rng(0)
    points = random.uniform([-1.5, -1.5, 1.8], [1.5, 1.5, 2.2], (80, 3))
    colors = random.integers(256, size=(80, 3), dtype=np.uint8)
    gaussians = opaque(points, colors, logit=3.0, sh_degree=1)
    folder = tmp_path / "project"
    (folder / "images").mkdir(parents=True)
    frames, poses = [], sideways(np.linspace(-0.4, 0.4, 6))
    for number, picture in enumerate(photographs(gaussians, poses, CAMERA)):
        Image.fromarray(picture).save(folder / f"images/{number}.png")
        opengl = (poses[number] * [1, -1, -1, 1]).tolist()
        frames.append({"file_path": f"images/{number}.png", "transform_matrix": opengl})
    lens = {"w": 96, "h": 96, "fl_x": 88, "fl_y": 88, "cx": 48, "cy": 48}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    return folder, gaussians, write(tmp_path / "point_cloud.ply", ply(gsplat_columns(gaussians)))


def test_the_content_of_the_file_decides_whether_it_is_read_again(one_scene, splat):
    """A transform of nerfstudio that appears beside it counts, too; the time of the file does not."""
    folder, gaussians, path = splat
    still = "splats.masking=none segments.track_moving=never"
    workdir = one_scene("plain", folder, f"splats.source={path} frames.known_poses=transforms {still}")
    target = f"{SCENE}/splats.zarr"
    language = workdir.stale(f"{SCENE}/language.zarr")
    assert {"splats", "instances", "features", "language"} <= language and not {
        "transient",
        "masks",
    } & language
    workdir.run(target)
    made = open_artifact(workdir.folder / target, SPLATS)
    assert np.array_equal(made.read("means"), gaussians.means.numpy())
    assert workdir.stale(target) == set()
    path.touch()
    assert workdir.stale(target) == set()
    beside = path.with_name("dataparser_transforms.json")
    beside.write_text(json.dumps({"transform": np.eye(4)[:3].tolist(), "scale": 1.0}))
    assert workdir.stale(target) == {"splats"}
    beside.unlink()
    write(path, ply(gsplat_columns(gaussians.select(gaussians.means[:, 0] < 0.9))))
    assert workdir.stale(target) == {"splats"}


def test_a_missing_file_is_named_before_anything_runs(one_scene, splat):
    folder, _, path = splat
    path.unlink()
    workdir = one_scene("plain", folder, f"splats.source={path}")
    done = workdir.snakemake("--", f"{SCENE}/metrics.json")
    told = [line for line in done.stderr.splitlines() if line.startswith("egosplat: splats.source")]
    assert done.returncode and len(told) == 1 and str(path) in told[0]
    assert not (workdir.folder / "results").exists() or not any((workdir.folder / "results").rglob("*.zarr"))
