"""ADT's tables about each frame: object poses, 2D boxes, skeletons, eye gaze."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from egosplat_apartments.adt_format.adt_images import RGB_STREAM, WITH_PEOPLE
from egosplat_apartments.adt_format.aria import DEVICE_SERIAL
from egosplat_apartments.adt_format.sequence import Frame, Sequence, View

_POSE_COLUMNS = ["t_wo_x[m]", "t_wo_y[m]", "t_wo_z[m]", "q_wo_w", "q_wo_x", "q_wo_y", "q_wo_z"]
_BOX_COLUMNS = ["x_min[pixel]", "x_max[pixel]", "y_min[pixel]", "y_max[pixel]", "visibility_ratio[%]"]
_GAZE_ANGLES = ["yaw_low_rads_cpf", "pitch_low_rads_cpf", "yaw_high_rads_cpf", "pitch_high_rads_cpf"]
_GAZE_DEPTH_M = 1.0
_STATIC_TIME = -1


class TruthTables:
    """Collects the ground truth of each frame and writes it at the end.

    Each row has its frame's ground-truth timestamp. The values are those of the middle of the exposure, about
    2.4 ms later, because that is what the image shows.
    """

    def __init__(self, sequence: Sequence) -> None:
        """Prepare empty tables.

        Raises:
            ValueError: ``world_from_static`` does not hold exactly the static objects.
        """
        objects = [one for one in sequence.instances if one.instance_type == "object"]
        self._static = {one.instance_id for one in objects if one.motion_type == "static"}
        self._dynamic = {one.instance_id for one in objects if one.motion_type == "dynamic"}
        self._people = {
            one.instance_id: one.name for one in sequence.instances if one.instance_type == "human"
        }
        self._ids = np.array(sorted(one.instance_id for one in sequence.instances), dtype=np.uint64)
        _check_ids("world_from_static", set(sequence.world_from_static), self._static)
        static = sorted(sequence.world_from_static.items())
        self._poses = [(uid, _STATIC_TIME, *_pose_numbers(pose)) for uid, pose in static]
        self._boxes: dict[str, list[tuple[float | str, ...]]] = {"": [], WITH_PEOPLE: []}
        self._joints: dict[int, list[dict[str, object]]] = {person: [] for person in self._people}
        self._times_ns: list[int] = []

    def add(self, frame: Frame, truth_ns: int) -> None:
        """Add a frame.

        Raises:
            ValueError: its poses or skeletons are not exactly those of the dynamic objects and the people, or
                its segmentation has an unknown instance.
        """
        _check_ids("world_from_object", set(frame.world_from_object), self._dynamic)
        _check_ids("skeletons", set(frame.skeletons), set(self._people))
        self._times_ns.append(truth_ns)
        for uid, pose in sorted(frame.world_from_object.items()):
            self._poses.append((uid, truth_ns, *_pose_numbers(pose)))
        for suffix, view in (("", frame.without_people), (WITH_PEOPLE, frame.with_people)):
            for uid, box in bounding_boxes(view.segmentation, self._ids).items():
                self._boxes[suffix].append((RGB_STREAM, uid, truth_ns, *box, _visibility(view, uid)))
        for person, joints in frame.skeletons.items():
            self._joints[person].append({"markers": [], "joints": joints.tolist(), "timestamp_ns": truth_ns})

    def write(self, folder: Path) -> None:
        """Write ``scene_objects.csv``, ``2d_bounding_box*.csv``, ``eyegaze.csv`` and the skeleton files."""
        columns = ["object_uid", "timestamp[ns]", *_POSE_COLUMNS]
        pd.DataFrame(self._poses, columns=columns).to_csv(folder / "scene_objects.csv", index=False)
        columns = ["stream_id", "object_uid", "timestamp[ns]", *_BOX_COLUMNS]
        for suffix, rows in self._boxes.items():
            pd.DataFrame(rows, columns=columns).to_csv(folder / f"2d_bounding_box{suffix}.csv", index=False)
        self._gaze().to_csv(folder / "eyegaze.csv", index=False)
        for person, frames in self._joints.items():
            skeleton = {"dt_optitrack_minus_device_ns": {DEVICE_SERIAL: 0}, "frames": frames}
            (folder / f"{self._people[person]}.json").write_text(json.dumps(skeleton))

    def _gaze(self) -> pd.DataFrame:
        """Eye gaze straight ahead: the synthetic wearer has no eyes."""
        count = len(self._times_ns)
        ahead = dict.fromkeys(["yaw_rads_cpf", "pitch_rads_cpf"], np.zeros(count))
        bounds = dict.fromkeys(_GAZE_ANGLES, np.zeros(count))
        times_us = np.array(self._times_ns, dtype=np.int64) // 1000
        return pd.DataFrame(
            {"tracking_timestamp_us": times_us, **ahead, "depth_m": np.full(count, _GAZE_DEPTH_M), **bounds}
        )


def bounding_boxes(
    segmentation: NDArray[np.uint64], ids: NDArray[np.uint64]
) -> dict[int, tuple[int, int, int, int]]:
    """Bounding box of each visible instance in ADT's order: first and last column, first and last row.

    Args:
        segmentation: (H, W) uint64 instance ids; 0 is background.
        ids: (N,) uint64, all instances, increasing.

    Raises:
        ValueError: the segmentation has an id that is neither 0 nor in ``ids``.
    """
    place = np.searchsorted(ids, segmentation).clip(max=len(ids) - 1)
    empty = segmentation == 0
    unknown = segmentation[(ids[place] != segmentation) & ~empty]
    if len(unknown):
        raise ValueError(f"the segmentation has id {unknown[0]}, which no instance has")
    slices = ndimage.find_objects(np.where(empty, 0, place + 1), max_label=len(ids))
    return {
        int(uid): (columns.start, columns.stop - 1, rows.start, rows.stop - 1)
        for uid, found in zip(ids, slices, strict=True)
        if found is not None
        for rows, columns in [found]
    }


def _visibility(view: View, uid: int) -> float:
    if uid not in view.visibility:
        raise ValueError(f"instance {uid} has pixels but no visibility")
    return view.visibility[uid]


def _pose_numbers(pose: NDArray[np.float64]) -> tuple[float, ...]:
    """Translation, then the quaternion with the real part first."""
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True).tolist()
    return (*pose[:3, 3].tolist(), w, x, y, z)


def _check_ids(name: str, given: set[int], expected: set[int]) -> None:
    if given != expected:
        raise ValueError(
            f"{name}: missing {sorted(expected - given)}, not expected {sorted(given - expected)}"
        )
