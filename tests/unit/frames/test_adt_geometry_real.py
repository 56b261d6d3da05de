"""Cameras and poses agree with ADT's boxes and depth on a real recording."""

import numpy as np
import pandas as pd
import pytest
from projectaria_tools.projects.adt import AriaDigitalTwinDataPaths, AriaDigitalTwinDataProvider
from scipy.spatial.transform import Rotation

from egosplat.frames.adt import RGB_LABEL, RGB_STREAM, open_recording, open_video
from egosplat.frames.adt_annotations import open_annotations
from egosplat.frames.native_log import captured_log
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.rectify import Rectification
from egosplat.geometry import ARIA_PIXEL_OFFSET, invert, make_pose, transform

OPTIONS = FramesOptions(resolution=352, upright=True)
ANNOTATION_NS = [87551170910000, 87551204237999]


def rgb_calibration(sample):
    return open_video(sample).get_device_calibration().get_camera_calib(RGB_LABEL)


def poses(table, translation, rotation):
    return make_pose(
        Rotation.from_quat(table[rotation].to_numpy()).as_matrix(), table[translation].to_numpy()
    )


@pytest.fixture(scope="module")
def world_from_device(sample):
    """Pose of the device at the moment of each annotation."""
    table = pd.read_csv(sample / "aria_trajectory.csv")
    rows = [(table["tracking_timestamp_us"] * 1000 - time).abs().idxmin() for time in ANNOTATION_NS]
    axes = [f"t{axis}_world_device" for axis in "xyz"], [f"q{axis}_world_device" for axis in "xyzw"]
    return poses(table.loc[rows], *axes)


@pytest.fixture(scope="module")
def boxes(sample):
    """Of the objects mostly visible in the first annotated frame: 3D box center in the world, and 2D box."""
    seen = pd.read_csv(sample / "2d_bounding_box.csv")
    seen = seen[(seen["stream_id"] == "214-1") & (seen["timestamp[ns]"] < ANNOTATION_NS[0] + 10**6)]
    seen = seen[seen["visibility_ratio[%]"] > 0.5].set_index("object_uid")
    bounds = pd.read_csv(sample / "3d_bounding_box.csv").set_index("object_uid").loc[seen.index]
    local = np.column_stack(
        [bounds[[f"p_local_obj_{axis}min[m]", f"p_local_obj_{axis}max[m]"]].mean(axis=1) for axis in "xyz"]
    )
    objects = pd.read_csv(sample / "scene_objects.csv").sort_values("timestamp[ns]")
    objects = objects[objects["timestamp[ns]"] < ANNOTATION_NS[0] + 10**6].groupby("object_uid").last()
    placed = poses(
        objects.loc[seen.index], [f"t_wo_{axis}[m]" for axis in "xyz"], [f"q_wo_{axis}" for axis in "xyzw"]
    )
    centers = np.einsum("nij,nj->ni", placed[:, :3], np.c_[local, np.ones(len(local))])
    return seen.assign(x=centers[:, 0], y=centers[:, 1], z=centers[:, 2])


@pytest.mark.parametrize("upright", [False, True])
def test_the_pinhole_camera_finds_the_instances_at_box_centers(sample, boxes, world_from_device, upright):
    recording = open_recording(sample, OPTIONS.change(resolution=1408, upright=upright))
    reader = open_annotations(sample, AnnotationKeys(recording.camera, upright))
    (instance_map,) = reader.read(ANNOTATION_NS[0])
    world = boxes[["x", "y", "z"]].to_numpy()
    camera_from_world = invert(world_from_device[0] @ recording.device_from_camera)
    pixels = recording.camera.project(transform(camera_from_world, world))
    usable = recording.camera.contains(pixels)
    u, v = np.floor(pixels[usable]).astype(int).T
    found = np.array([instance.id for instance in reader.instances] + [0])[instance_map[v, u]]
    # The same, from the fisheye image: whatever is in front of a box's center there is so here.
    calibration = rgb_calibration(sample)
    sensor_from_world = invert(world_from_device[0] @ calibration.get_transform_device_camera().to_matrix())
    source = [calibration.project_no_checks(point) for point in transform(sensor_from_world, world[usable])]
    u, v = np.floor(np.array(source) + ARIA_PIXEL_OFFSET).astype(int).clip(0, 1407).T
    assert usable.sum() >= 70
    raw = adt_provider(sample).get_segmentation_image_by_timestamp_ns(ANNOTATION_NS[0], RGB_STREAM).data()
    assert (raw.to_numpy_array()[v, u] == found)[found > 0].mean() > 0.95
    assert (found == boxes.index.to_numpy()[usable]).mean() > 0.6


def adt_provider(sample):
    paths = AriaDigitalTwinDataPaths()
    paths.aria_vrs_filepath = str(sample / "video.vrs")
    paths.segmentations_filepath = str(sample / "segmentations_with_skeleton.vrs")
    paths.depth_images_filepath = str(sample / "depth_images.vrs")
    with captured_log():
        return AriaDigitalTwinDataProvider(paths)


def test_depth_and_instances_warp_onto_the_other_frame(sample, copy, full_size, world_from_device):
    """Without people: between the frames the wearer's hands move by up to a finger's width."""
    camera = full_size.camera
    (copy / "segmentations_with_skeleton.vrs").unlink()
    reader = open_annotations(copy, AnnotationKeys(camera, True))
    ids = [reader.read(time)[0] for time in ANNOTATION_NS]
    provider = adt_provider(sample)
    found = [provider.get_depth_image_by_timestamp_ns(time, RGB_STREAM) for time in ANNOTATION_NS]
    rectification = Rectification(rgb_calibration(sample), camera, 1)
    depth = [rectification.labels(one.data().to_numpy_array()) * 1e-3 for one in found]
    world_from_camera = world_from_device @ full_size.device_from_camera
    v, u = np.nonzero(depth[0] > 0)
    z = depth[0][v, u]
    # Depth is along the optical axis, which the fisheye and the pinhole camera share.
    x, y = (u + 0.5 - camera.cx) / camera.fx * z, (v + 0.5 - camera.cy) / camera.fy * z
    points = np.stack([x, y, z], axis=-1)
    moved = transform(invert(world_from_camera[1]) @ world_from_camera[0], points)
    pixels = camera.project(moved)
    inside = camera.contains(pixels)
    to_u, to_v = np.floor(pixels[inside]).astype(int).T
    seen = depth[1][to_v, to_u] > 0
    difference = np.abs(depth[1][to_v, to_u] - moved[inside, 2])[seen]
    assert seen.sum() > 1_400_000
    assert np.median(difference) < 1.1e-3
    assert (ids[1][to_v, to_u] == ids[0][v, u][inside])[seen].mean() >= 0.98
