"""What moves in a recording in ADT's format: the true instances of every frame, and which of them change place."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.frames.annotation_readers import open_annotations
from egosplat.frames.recording import Annotations
from egosplat.geometry import Camera

MOVED_M = 0.02
"""An object that stays within this is still, whatever its label (EgoLifter's rule; docs/method.md#static-dynamic)."""

MAX_AGE_NS = 3_000_000


@dataclass(frozen=True)
class Truth:
    """The truth of one recording.

    Attributes:
        names: of its N instances.
        moves: (N,) bool.
    """

    names: list[str]
    moves: NDArray[np.bool_]
    _reader: Annotations
    _times: NDArray[np.int64]

    def labels(self, frame: int) -> NDArray[np.int32]:
        """(H, W) instance of each pixel, -1 for none."""
        found = self._reader.instance_map(int(self._times[frame]))
        if found is None:
            raise ValueError(f"frame {frame} is not annotated")
        return found

    def all_labels(self) -> Iterator[NDArray[np.int32]]:
        """The same of all frames in turn."""
        return (self.labels(frame) for frame in range(len(self._times)))


def read_truth(recording: Path, frames: Artifact) -> Truth:
    """The truth of the recording that ``frames`` was read from."""
    reader = open_annotations(
        "adt",
        recording,
        camera=Camera(**frames.facts["camera"]),
        upright=frames.facts["upright"],
        max_age_ns=MAX_AGE_NS,
    )
    if reader is None:
        raise ValueError(f"{recording}: is not annotated")
    moved = _moved(recording / "scene_objects.csv")
    moves = [one.instance_type == "human" or one.id in moved for one in reader.instances]
    names = [one.name for one in reader.instances]
    return Truth(names, np.array(moves), reader, frames.read("timestamp_ns"))


def _moved(table: Path) -> set[int]:
    """Ids of the objects that change place."""
    rows = pd.read_csv(table)
    places = rows.groupby("object_uid")[["t_wo_x[m]", "t_wo_y[m]", "t_wo_z[m]"]]
    span = np.linalg.norm(places.max() - places.min(), axis=1)
    return set(places.max().index[span > MOVED_M])
