"""A synthetic recording, read as any ADT sequence is, against the truth it was made from."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.colmap.alignment import trajectory_error
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS, FRAMES, POSES
from egosplat.frames import annotations_stage, stage
from egosplat.frames.adt import EXPOSURE_MIDDLE_AFTER_CAPTURE_NS
from egosplat.geometry import CLOCKWISE, Camera, invert, rotation_angle, transform
from egosplat.pipeline.config import defaults
from egosplat.poses import stage as poses_stage
from egosplat_apartments.adt_format.adt import write_sequence
from egosplat_apartments.adt_format.aria import device_from_camera
from egosplat_apartments.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Sequence
from egosplat_apartments.stage import make_sequence

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("synthetic")


def find_poses(folder: Path, name: str, **changes: str) -> None:
    options = poses_stage.PosesOptions(**defaults()["poses"] | changes)
    poses_stage.run(folder / "recording", folder / "frames.zarr", folder / name, options)


@pytest.fixture(scope="module")
def sequence(folder) -> Sequence:
    made = make_sequence(name="test", seed=11, size=352, fps=4.0, seconds=9.0, objects=20, motion=0.5)
    recording, frames = folder / "recording", folder / "frames.zarr"
    write_sequence(made, recording)
    keys = defaults()["frames"] | {"resolution": 352, "evaluation_frames": 6}
    stage.run(recording, frames, stage.FramesOptions(**keys), format="adt")
    options = annotations_stage.AnnotationsOptions()
    annotations_stage.run(recording, frames, folder / "annotations.zarr", options)
    find_poses(folder, "poses.zarr")
    return made


@pytest.fixture(scope="module")
def opened(sequence, folder) -> dict[str, Artifact]:
    schemas = {"frames": FRAMES, "annotations": ANNOTATIONS, "poses": POSES}
    return {name: open_artifact(folder / f"{name}.zarr", schema) for name, schema in schemas.items()}


@pytest.fixture(scope="module")
def truth(sequence, opened) -> np.ndarray:
    """(F, 4, 4) true poses of the upright pictures."""
    times = opened["frames"].read("exposure_middle_ns")
    return sequence.device_pose(times) @ device_from_camera() @ CLOCKWISE


def test_reader_and_writer_agree_on_the_exposure_middle_and_the_origin(opened):
    assert EXPOSURE_MIDDLE_AFTER_CAPTURE_NS == ROLLING_SHUTTER_MIDDLE_NS
    assert {artifact.origin for artifact in opened.values()} == {"synthetic"}


def test_poses_agree_to_numerical_precision(opened, truth):
    poses = opened["poses"]
    assert poses.read("registered").all()
    found = poses.read("camera_to_world")
    assert np.abs(found[:, :3, 3] - truth[:, :3, 3]).max() < 1e-6
    assert rotation_angle(invert(truth) @ found).max() < 1e-6
    np.testing.assert_allclose(poses.read("up"), [0, 1, 0], atol=1e-9)


def test_objects_are_seen_where_they_are(sequence, opened, truth):
    """The center of each static object's box projects into or next to its own pixels."""
    frames, annotations = opened["frames"], opened["annotations"]
    camera = Camera(**frames.facts["camera"])
    instances = {one["id"]: index for index, one in enumerate(annotations.facts["instances"])}
    edge = cv2.erode(frames.read("valid").astype(np.uint8), np.ones((9, 9))) == 0
    near = seen = 0
    for row, frame in enumerate(annotations.read("frame")):
        labels = annotations.row("instance_map", row)
        for instance in sequence.instances:
            pixels = np.argwhere(labels == instances[instance.instance_id]) + 0.5
            pose = sequence.world_from_static.get(instance.instance_id)
            if pose is None or instance.category == "shelter" or len(pixels) < 40:
                continue
            center = transform(invert(truth[frame]), transform(pose, instance.bounds.mean(axis=0)))
            u, v = camera.project(center)
            if edge[labels == instances[instance.instance_id]].any():  # cut off by the lens circle
                continue
            low, high = pixels.min(axis=0) - 3, pixels.max(axis=0) + 3
            near += bool(low[0] <= v <= high[0] and low[1] <= u <= high[1])
            seen += 1
    assert seen >= 10 and near >= 0.9 * seen  # some are hidden in part


def test_points_lie_on_what_is_seen(opened, truth):
    """Semi-dense points project inside the picture and are separated by the lens circle only."""
    camera, points = Camera(**opened["frames"].facts["camera"]), opened["poses"].read("points/xyz")
    seen = np.zeros(len(points), bool)
    for pose in truth:
        seen |= camera.contains(camera.project(transform(invert(pose), points)))
    assert len(points) > 5_000 and seen.mean() > 0.97


def test_people_are_annotated_and_something_is_carried(opened):
    instances = opened["annotations"].facts["instances"]
    assert opened["annotations"].read("annotated").all()
    assert sum(one["instance_type"] == "human" for one in instances) >= 1
    assert len({one["category"] for one in instances}) >= 12
    assert {one["motion_type"] for one in instances} == {"static", "dynamic"}


def test_colmap_finds_the_true_trajectory(folder, truth):
    find_poses(folder, "colmap.zarr", method="colmap")
    found = open_artifact(folder / "colmap.zarr", POSES)
    registered = found.read("registered")
    assert registered.mean() >= 0.9
    error = trajectory_error(found.read("camera_to_world")[registered], truth[registered])
    assert error["ate_rmse_m"] < 0.03 and error["rotation_rmse_deg"] < 2.0, error
