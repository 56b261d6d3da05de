"""Write a synthetic recording as an Aria Digital Twin sequence folder (docs/method.md#adt-files)."""

import json
import uuid
from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.files import atomic_directory
from egosplat.geometry import compose
from egosplat.progress import track
from egosplat_apartments.adt_format.adt_images import create_images
from egosplat_apartments.adt_format.adt_truth import TruthTables
from egosplat_apartments.adt_format.aria import DEVICE_SERIAL
from egosplat_apartments.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Instance, Sequence
from egosplat_apartments.arrays import Times, Trajectory

_TRUTH_AFTER_CAPTURE_NS = 90_000


def write_sequence(sequence: Sequence, folder: Path, *, jpeg_quality: int = 95) -> None:
    """Write a complete sequence folder that projectaria-tools' ADT provider opens.

    The folder appears once it is complete. An interrupted run leaves at most a hidden scratch folder.

    Args:
        sequence: the recording; its frames are rendered one by one and not kept.
        folder: the folder to make; must not exist.
        jpeg_quality: 1 to 95.

    Raises:
        UserError: ``folder`` exists.
        ValueError: the sequence contradicts itself.
    """
    if folder.exists():
        raise UserError(f"{folder}: exists already and is not replaced; give another --output")
    with atomic_directory(folder) as scratch:
        truth = TruthTables(sequence)
        captures: list[int] = []
        with create_images(scratch, sequence, jpeg_quality) as images:
            for number, frame in enumerate(_frames(sequence)):
                truth_ns = ground_truth_ns(frame.capture_ns)
                images.write(frame, number, truth_ns)
                truth.add(frame, truth_ns)
                captures.append(frame.capture_ns)
        truth.write(scratch)
        if sequence.rests:
            _write_rests(scratch / "truth", sequence)
        write_documents(scratch, sequence)
        capture_ns = np.array(captures, dtype=np.int64)
        truth_times = np.array([ground_truth_ns(time) for time in captures], dtype=np.int64)
        write_trajectories(scratch, sequence, truth_times, capture_ns + ROLLING_SHUTTER_MIDDLE_NS)


def ground_truth_ns(capture_ns: int) -> int:
    """Timestamp of an image's ground truth, on the microsecond grid.

    ADT's ground truth follows the SLAM cameras, which capture about 0.09 ms after the RGB camera.
    """
    return (capture_ns + _TRUTH_AFTER_CAPTURE_NS + 500) // 1000 * 1000


def _frames(sequence: Sequence) -> Iterator[Frame]:
    """Yield the frames with a progress bar; check their order and number."""
    last_ns, count = None, 0
    for frame in track(sequence.frames(), f"writing {sequence.name}", total=sequence.frame_count):
        if last_ns is not None and frame.capture_ns <= last_ns:
            raise ValueError(f"frame {count} was captured at {frame.capture_ns} ns, not after {last_ns} ns")
        last_ns = frame.capture_ns
        count += 1
        yield frame
    if count != sequence.frame_count:
        raise ValueError(f"{count} frames, not {sequence.frame_count}")


def write_documents(folder: Path, sequence: Sequence) -> None:
    """Write ``instances.json``, ``3d_bounding_box.csv``, ``skeleton_aria_association.json``, ``metadata.json``."""
    _write_json(
        folder / "instances.json", {str(one.instance_id): _instance(one) for one in sequence.instances}
    )
    objects = [one for one in sequence.instances if one.instance_type == "object"]
    # Each box is in the instance's own frame and never changes: time -1.
    rows = [(one.instance_id, -1, *one.bounds.T.ravel().tolist()) for one in objects]
    columns = ["object_uid", "timestamp[ns]"]
    columns += [f"p_local_obj_{axis}{end}[m]" for axis in "xyz" for end in ("min", "max")]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "3d_bounding_box.csv", index=False)
    people = [one for one in sequence.instances if one.instance_type == "human"]
    association = {"SkeletonMetadata": [_skeleton(person, sequence.wearer) for person in people]}
    _write_json(folder / "skeleton_aria_association.json", association)
    _write_json(folder / "metadata.json", _metadata(len(people)))


def _instance(one: Instance) -> dict[str, Any]:
    return {
        "instance_id": one.instance_id,
        "instance_name": one.name,
        "prototype_name": one.prototype,
        "category": one.category,
        "category_uid": one.category_uid,
        "motion_type": one.motion_type,
        "instance_type": one.instance_type,
        "rigidity": "deformable" if one.instance_type == "human" else "rigid",
        "rotational_symmetry": {"is_annotated": False},
        "canonical_pose": {"up_vector": [0, 1, 0], "front_vector": [0, 0, 1]},
    }


def _skeleton(person: Instance, wearer: int | None) -> dict[str, Any]:
    device = DEVICE_SERIAL if person.instance_id == wearer else "NONE"
    return {"AssociatedDeviceSerial": device, "SkeletonId": person.instance_id, "SkeletonName": person.name}


def _metadata(people: int) -> dict[str, Any]:
    """ADT's keys, and ``origin``, which ADT does not have."""
    return {
        "serial": DEVICE_SERIAL,
        # Empty, so that the same sequence gives the same files.
        "gt_creation_time": "",
        "scene": "SyntheticApartment",
        "is_multi_person": False,
        "num_skeletons": people,
        "timecode_enabled": 0,
        "gt_time_domain": "DEVICE_CAPTURE",
        "concurrent_sequence": "",
        # Name and version of the format; projectaria-tools accepts no other name.
        "dataset_name": "ADT_2023",
        "dataset_version": "2.0",
        "origin": "synthetic",
    }


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=2) + "\n")


_TRUTH_PERIOD_US, _SLAM_PERIOD_US = 33_333, 1000
_VELOCITY_STEP_NS = 500_000
_GRAVITY_WORLD = (0.0, -9.81, 0.0)


def write_trajectories(folder: Path, sequence: Sequence, truth_ns: Times, middle_ns: Times) -> None:
    """Write ``aria_trajectory.csv`` and the files of MPS in ``mps/slam/``.

    Rows are 33 ms and 1 ms apart, as in ADT, at any frame rate. Both files also have a row at every
    ground-truth time and one within 0.5 us of the middle of every exposure, so that a pose at these times
    needs no interpolation. The rows cover the sequence from start to end.

    Args:
        folder: the sequence folder.
        truth_ns: (F,) ground-truth times; middle_ns: (F,) middles of the exposures.

    Raises:
        ValueError: one of these times lies outside the trajectory.
    """
    span_us = np.array([-(-sequence.start_ns // 1000), sequence.end_ns // 1000])
    needed_us = np.concatenate([_to_us(truth_ns), _to_us(middle_ns)])
    if len(needed_us) and (needed_us.min() < span_us[0] or needed_us.max() > span_us[1]):
        raise ValueError("the trajectory does not cover every frame's ground-truth time and exposure middle")
    slam = folder / "mps" / "slam"
    slam.mkdir(parents=True)
    estimated = sequence.estimated_pose or sequence.device_pose
    files = {
        folder / "aria_trajectory.csv": (_TRUTH_PERIOD_US, sequence.device_pose),
        slam / "closed_loop_trajectory.csv": (_SLAM_PERIOD_US, estimated),
    }
    for path, (period_us, pose) in files.items():
        # The needed times are rows of their own, so that a reader interpolates nothing there.
        grid_us = np.arange(span_us[0], span_us[1], period_us)
        times_us = np.unique(np.concatenate([span_us, grid_us, needed_us]))
        trajectory_table(sequence, times_us, pose).to_csv(path, index=False)
    _write_points(slam / "semidense_points.csv.gz", sequence)
    exact, erring = "exact poses, not estimated ones", "poses with the error of an estimate"
    how = erring if sequence.estimated_pose else exact
    summary = {"SLAM": {"status": "SUCCESS", "message": f"synthetic: {how}"}}
    _write_json(slam / "summary.json", summary)


def trajectory_table(sequence: Sequence, times_us: Times, device_pose: Trajectory) -> pd.DataFrame:
    """Columns of a trajectory at ``times_us``, (N,) increasing microseconds of device time."""
    pose = device_pose(times_us * 1000)
    linear, angular = _velocities(sequence, times_us * 1000, device_pose)
    count = len(times_us)
    quaternion = Rotation.from_matrix(pose[:, :3, :3]).as_quat(canonical=True)
    columns = {"graph_uid": _graph_uid(sequence), "tracking_timestamp_us": times_us, "utc_timestamp_ns": -1}
    columns |= {f"t{axis}_world_device": pose[:, row, 3] for row, axis in enumerate("xyz")}
    columns |= {f"q{axis}_world_device": quaternion[:, row] for row, axis in enumerate("xyzw")}
    columns |= {f"device_linear_velocity_{axis}_device": linear[:, row] for row, axis in enumerate("xyz")}
    columns |= {f"angular_velocity_{axis}_device": angular[:, row] for row, axis in enumerate("xyz")}
    columns |= {f"gravity_{axis}_world": _GRAVITY_WORLD[row] for row, axis in enumerate("xyz")}
    return pd.DataFrame({**columns, "quality_score": np.ones(count)})


def _velocities(
    sequence: Sequence, times_ns: Times, device_pose: Trajectory
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) linear [m/s] and angular [rad/s] velocity in the device frame, from differences over 1 ms."""
    # Central differences, one-sided at the ends of the trajectory.
    before = np.maximum(times_ns - _VELOCITY_STEP_NS, sequence.start_ns)
    after = np.minimum(times_ns + _VELOCITY_STEP_NS, sequence.end_ns)
    seconds = np.maximum(after - before, 1)[:, None] * 1e-9
    first, last = device_pose(before), device_pose(after)
    to_device = np.swapaxes(first[:, :3, :3], -1, -2)
    linear = np.einsum("nij,nj->ni", to_device, last[:, :3, 3] - first[:, :3, 3]) / seconds
    angular = Rotation.from_matrix(compose(to_device, last[:, :3, :3])).as_rotvec() / seconds
    return linear, angular


def _write_rests(folder: Path, sequence: Sequence) -> None:
    """Write ``rests.tsv``: where each object that people carry lies, and from when until when."""
    folder.mkdir()
    names = {one.instance_id: one.name for one in sequence.instances}
    columns = ["object_uid", "object", "place_uid", "place", "from[ns]", "until[ns]"]
    rests = map(astuple, sequence.rests)
    rows = [(uid, names[uid], place, names[place], *times) for uid, place, *times in rests]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "rests.tsv", sep="\t", index=False)


def _write_points(path: Path, sequence: Sequence) -> None:
    count = len(sequence.points)
    columns = {"uid": np.arange(count), "graph_uid": _graph_uid(sequence)}
    columns |= {f"p{axis}_world": sequence.points[:, row] for row, axis in enumerate("xyz")}
    columns |= {"inv_dist_std": sequence.inv_dist_std, "dist_std": sequence.dist_std}
    # A fixed time in the gzip header, so that the same sequence gives the same bytes.
    pd.DataFrame(columns).to_csv(path, index=False, compression={"method": "gzip", "mtime": 0})


def _graph_uid(sequence: Sequence) -> str:
    """Identifier of the world frame."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"egosplat/{sequence.name}"))


def _to_us(times_ns: Times) -> Times:
    return (np.asarray(times_ns, dtype=np.int64) + 500) // 1000
