"""Ground truth of motion in a recording of ADT's format: true instances of every frame, and which of them move."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.frames.adt_annotations import open_annotations
from egosplat.frames.recording import AnnotationKeys, Annotations
from egosplat.geometry import Camera

# Range of an object's position up to which it is static, whatever its label (docs/method.md#static-dynamic).
MOVED_M = 0.02


@dataclass(frozen=True)
class Truth:
    """The truth of one recording.

    Attributes:
        names, categories: of its N instances.
        moves: (N,) bool.
    """

    names: list[str]
    categories: list[str]
    moves: NDArray[np.bool_]
    _reader: Annotations
    _times: NDArray[np.int64]

    def all_labels(self) -> Iterator[NDArray[np.int32]]:
        """(H, W) instance of each pixel, -1 for none, of all frames in turn."""
        for frame, time in enumerate(self._times.tolist()):
            layers = self._reader.read(time)
            if layers is None:
                raise ValueError(f"frame {frame} is not annotated")
            yield layers[0]


def read_truth(recording: Path, frames: Artifact) -> Truth:
    """The truth of the recording that ``frames`` was read from."""
    keys = AnnotationKeys(Camera(**frames.facts["camera"]), frames.facts["upright"])
    reader = open_annotations(recording, keys)
    if reader is None:
        raise ValueError(f"{recording}: is not annotated")
    moved = moved_objects(recording / "scene_objects.csv")
    moves = [one.instance_type == "human" or one.id in moved for one in reader.instances]
    names, categories = zip(*((one.name, one.category) for one in reader.instances), strict=True)
    return Truth([*names], [*categories], np.array(moves), reader, frames.read("timestamp_ns"))


def moved_objects(table: Path) -> set[int]:
    """Ids of the objects that move."""
    rows = pd.read_csv(table)
    places = rows.groupby("object_uid")[["t_wo_x[m]", "t_wo_y[m]", "t_wo_z[m]"]]
    span = np.linalg.norm(places.max() - places.min(), axis=1)
    return set(places.max().index[span > MOVED_M])
