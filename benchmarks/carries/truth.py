"""Where carried things lie, and from when until when, in a synthetic recording."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.frames.adt import RGB_STREAM
from egosplat.frames.adt_annotations import read_instances
from egosplat.geometry import Array, transform

# Shorter rests are not counted [s].
LEAST_S = 2.0

_SIDES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Rest:
    """A thing at one place.

    Attributes:
        name, category: of the thing; ``uid`` its number in the recording.
        from_s, until_s: seconds since the first frame.
        object_to_world: (4, 4) float64.
        low, high: (3,) float64 corners of its box in its own axes [m].
    """

    name: str
    category: str
    uid: int
    from_s: float
    until_s: float
    object_to_world: Array
    low: Array
    high: Array

    def distances(self, points: Array) -> Array:
        """(N,) distance of (N, 3) points in the world from the box [m]; 0 inside."""
        rotation, center = self.object_to_world[:3, :3], self.object_to_world[:3, 3]
        own = (points - center) @ rotation
        return np.linalg.norm(np.maximum(np.maximum(self.low - own, own - self.high), 0.0), axis=-1)

    def iou(self, first_s: float, last_s: float) -> float:
        """IoU of this rest and another interval of time."""
        both = min(last_s, self.until_s) - max(first_s, self.from_s)
        return max(both, 0.0) / (max(last_s, self.until_s) - min(first_s, self.from_s))


def scene_of(folder: Path) -> Path:
    """The folder of a scene, or of the scene of a variant."""
    return folder.parent.parent if folder.parent.name == "variants" else folder


def recording_of(folder: Path) -> Path:
    """The recording of a scene, or of the scene of a variant."""
    return (scene_of(folder) / "recording").resolve()


def read_rests(recording: Path, timestamp_ns: NDArray[np.int64]) -> list[Rest]:
    """Read the rests of a recording; ``timestamp_ns`` (F,) of its frames."""
    names = {one.id: one for one in read_instances(recording / "instances.json")}
    poses = pd.read_csv(recording / "scene_objects.csv").sort_values(["object_uid", "timestamp[ns]"])
    boxes = (
        pd.read_csv(recording / "3d_bounding_box.csv").drop_duplicates("object_uid").set_index("object_uid")
    )
    rests = pd.read_csv(recording / "truth" / "rests.tsv", sep="\t")
    found = []
    for row in rests.to_dict("records"):
        times = np.array([row["from[ns]"], row["until[ns]"]])
        from_s, until_s = np.clip(times, timestamp_ns[0], timestamp_ns[-1]) - timestamp_ns[0]
        if until_s - from_s < LEAST_S * 1e9:
            continue
        one, uid = names[row["object_uid"]], row["object_uid"]
        pose = _pose_at(poses[poses.object_uid == uid], int(times.mean()))
        sides = ([boxes.loc[uid, f"p_local_obj_{axis}{end}[m]"] for axis in _SIDES] for end in ("min", "max"))
        low, high = map(np.array, sides)
        found.append(Rest(one.name, one.category, uid, from_s / 1e9, until_s / 1e9, pose, low, high))
    return found


def read_boxes(recording: Path) -> dict[str, tuple[Array, float]]:
    """The middle of the box of each thing at first (3,), in the world, and its diagonal [m], by name."""
    poses, boxes = (pd.read_csv(recording / f"{name}.csv") for name in ("scene_objects", "3d_bounding_box"))
    found = {}
    for one in read_instances(recording / "instances.json"):
        own, box = poses[poses.object_uid == one.id], boxes[boxes.object_uid == one.id]
        if len(own) and len(box):
            low, high = (
                box.iloc[0][[f"p_local_obj_{axis}{end}[m]" for axis in _SIDES]] for end in ("min", "max")
            )
            low, high = low.to_numpy(float), high.to_numpy(float)
            pose = _pose_at(own, int(own["timestamp[ns]"].min()))
            found[one.name] = transform(pose, (low + high) / 2), float(np.linalg.norm(high - low))
    return found


def _pose_at(rows: pd.DataFrame, time: int) -> Array:
    row = rows[rows["timestamp[ns]"] <= time].iloc[-1]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([row[f"q_wo_{axis}"] for axis in (*_SIDES, "w")]).as_matrix()
    pose[:3, 3] = [row[f"t_wo_{axis}[m]"] for axis in _SIDES]
    return pose


@dataclass(frozen=True, eq=False)
class TrueCarry:
    """A thing on its way between two rests; ``frames`` show it meanwhile."""

    before: Rest
    after: Rest
    frames: int

    def iou(self, from_s: float, until_s: float) -> float:
        """IoU of this carry and another interval of time."""
        both = min(until_s, self.after.from_s) - max(from_s, self.before.until_s)
        whole = max(until_s, self.after.from_s) - min(from_s, self.before.until_s)
        return max(both, 0.0) / max(whole, 1e-9)


def read_carries(recording: Path, rests: Sequence[Rest], timestamp_ns: NDArray[np.int64]) -> list[TrueCarry]:
    """The carries between the rests of a recording."""
    boxes = pd.read_csv(recording / "2d_bounding_box.csv")
    boxes = boxes[boxes.stream_id == str(RGB_STREAM)]
    seconds = (boxes["timestamp[ns]"].to_numpy() - timestamp_ns[0]) / 1e9
    found = []
    for before, after in itertools.pairwise(rests):
        if before.uid == after.uid:
            on_way = (seconds >= before.until_s) & (seconds <= after.from_s)
            frames = int((on_way & (boxes.object_uid.to_numpy() == before.uid)).sum())
            found.append(TrueCarry(before, after, frames))
    return found
