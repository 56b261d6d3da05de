"""The picture of a scene is drawn from whatever its artifacts hold."""

from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.writer import create
from egosplat.geometry import Camera
from egosplat.report.contact_sheet import ground_axes, overlay, run

HEIGHT, WIDTH = 24, 24


def scene(folder, frames: int, evaluation: int, points: int, instances: int, registered: int):
    rng = np.random.default_rng(0)
    times = np.arange(frames) * 100_000_000
    with create(folder / "frames.zarr", FRAMES, begin("frames", {}, "synthetic")) as artifact:
        artifact.put("valid", np.ones((HEIGHT, WIDTH), bool))
        artifact.put("timestamp_ns", times)
        artifact.put("exposure_middle_ns", times)
        chosen = np.arange(frames) < evaluation
        artifact.put("train", ~chosen)
        artifact.put("evaluation", chosen)
        artifact.allocate("rgb", (frames, HEIGHT, WIDTH, 3))
        for index in range(frames):
            artifact.put_row("rgb", index, rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8))
        camera = Camera(WIDTH, HEIGHT, 20.0, 20.0, WIDTH / 2, HEIGHT / 2)
        artifact.facts = {"recording": "a recording", "camera": asdict(camera)}
    with create(folder / "annotations.zarr", ANNOTATIONS, begin("annotations", {}, "synthetic")) as artifact:
        artifact.put("frame", np.arange(evaluation))
        artifact.put("annotated", np.arange(evaluation) % 2 == 0)
        artifact.allocate("instance_map", (evaluation, HEIGHT, WIDTH))
        for row in range(evaluation):
            artifact.put_row(
                "instance_map", row, rng.integers(-1, instances, (HEIGHT, WIDTH), dtype=np.int32)
            )
        artifact.facts = {"instances": [{"category": f"thing {i}"} for i in range(instances)]}
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 0, 3] = np.arange(frames)
    poses[registered:] = np.nan
    with create(folder / "poses.zarr", POSES, begin("poses", {}, "synthetic")) as artifact:
        artifact.put("camera_to_world", poses)
        artifact.put("registered", np.arange(frames) < registered)
        artifact.put("intrinsics", np.eye(3))
        artifact.put("up", np.array([0.0, 1.0, 0.0]))
        artifact.put("points/xyz", rng.normal(size=(points, 3)))
        artifact.put("points/rgb", np.zeros((points, 3), np.uint8))
        artifact.facts = {"notes": {}}
    return [folder / f"{name}.zarr" for name in ("frames", "annotations", "poses")]


def test_a_page_of_portrait_pictures_is_readable(monkeypatch, tmp_path, drawn, unreadable):
    """Titles lay over one another."""
    monkeypatch.setitem(globals(), "HEIGHT", 32)
    monkeypatch.setitem(globals(), "WIDTH", 18)
    run(*scene(tmp_path, 20, 6, 50, 7, 20), tmp_path / "page.png", title="own/portrait")
    (figure,) = drawn
    assert unreadable(figure) == []


@pytest.mark.parametrize(
    "frames, evaluation, points, instances, registered",
    [(20, 5, 500, 7, 20), (3, 1, 1, 1, 2), (2, 0, 0, 0, 1)],
    ids=["usual", "few", "almost nothing"],
)
def test_a_picture_is_made(tmp_path, frames, evaluation, points, instances, registered):
    output = tmp_path / "sheet.png"
    run(*scene(tmp_path, frames, evaluation, points, instances, registered), output, title="a scene")
    picture = np.asarray(Image.open(output).convert("L"))
    assert picture.shape[1] > 1000 and picture.std() > 10
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".png") == ["sheet.png"]


@pytest.mark.parametrize(
    "up", [[0, 1, 0], [0, 0, 1], [1, 0, 0], [0.6, 0.8, 0], [0.577350269, 0.577350269, 0.577350269]]
)
def test_ground_axes_are_orthonormal_and_seen_from_above(up):
    right, ahead = ground_axes(np.asarray(up, float))
    frame = np.stack([right, ahead, up])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-8)
    assert np.linalg.det(frame) == pytest.approx(1.0)  # right x ahead = up: not mirrored


def test_overlay_tints_instances_apart_and_leaves_the_rest():
    picture = np.full((2, 2, 3), 100, np.uint8)
    tinted = overlay(picture, np.array([[-1, 0], [1, 0]], np.int32))
    assert (tinted[0, 0] == 100).all()
    assert (tinted[0, 1] == tinted[1, 1]).all() and (tinted[0, 1] != tinted[1, 0]).any()
