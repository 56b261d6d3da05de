"""A recording with annotations: a chair, two books of which one moves, a person, and the room."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS
from egosplat.evaluation import stage
from egosplat.frames.recording import Instance
from tests.support.scenes import put

HEIGHT, WIDTH = 30, 40
ARTIFACTS = ("frames", "poses", "annotations", "features", "splats", "language")


def score(folder: Path, artifacts: Sequence[str] = ARTIFACTS, told=None, **keys: Any) -> Path:
    """``folder/metrics.json``. One thing is asked for that is absent: the defaults' words take longer than all else."""
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in artifacts}
    options, output = stage.MetricsOptions(**{"negatives": ["basketball"]} | keys), folder / "metrics.json"
    stage.run(**paths, output=output, options=options, title="a/scene", **told or {})
    return output


@pytest.fixture
def instances() -> list[Instance]:
    """0 a chair, 1 and 2 books, of which 2 moves, 3 a person, 4 the room."""
    return [
        Instance(11, "Chair_1", "dining chair", "static", "object"),
        Instance(12, "Book_1", "book", "static", "object"),
        Instance(13, "Book_2", "book", "dynamic", "object"),
        Instance(14, "Ana", "person", "dynamic", "human"),
        Instance(15, "Room", "shelter", "static", "object"),
    ]


@pytest.fixture
def instance_map() -> np.ndarray:
    """(30, 40) int32: all five, a left border without any; chair 80, books 24 and 60, person 50 pixels."""
    labels = np.full((HEIGHT, WIDTH), 4, np.int32)
    labels[:, :2] = -1
    labels[2:10, 5:15] = 0
    labels[12:16, 5:11] = 1
    labels[12:18, 20:30] = 2
    labels[20:30, 30:35] = 3
    return labels


@pytest.fixture
def annotations(tmp_path: Path, instances: list[Instance]) -> Callable[..., Artifact]:
    """``annotations(maps, annotated)``: the artifact of evaluation frames 10, 20, ... of the recording."""

    def make(maps: np.ndarray, annotated: list[bool]) -> Artifact:
        arrays = {
            "instance_map": maps,
            "frame": 10 * np.arange(1, len(maps) + 1),
            "annotated": np.array(annotated, bool),
        }
        facts = {"instances": [asdict(one) for one in instances]}
        return open_artifact(put(tmp_path, "annotations", arrays, facts), ANNOTATIONS)

    return make
