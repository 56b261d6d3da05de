"""Artifacts that do not belong together are refused, by digest and by size."""

from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.consistency import check_inputs, check_made_from
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.pipeline.home import make_command

SOURCE = Schema("source", 1, {"time": Field("int64 frame", "ns", "time")})
MADE = Schema("made", 1, {"pose": Field("int64 4 frame", "m", "pose")})


def source(path: Path, *times: int) -> Artifact:
    with create(path, SOURCE, begin("frames", {}, "real")) as artifact:
        artifact.put("time", np.array(times))
    return open_artifact(path, SOURCE)


def made(path: Path, frames: int, inputs: dict[str, str]) -> Artifact:
    with create(path, MADE, begin("poses", {}, "real", inputs)) as artifact:
        artifact.put("pose", np.zeros((4, frames), np.int64))
    return open_artifact(path, MADE)


@pytest.fixture
def frames(tmp_path: Path) -> Artifact:
    return source(tmp_path / "frames.zarr", 1, 2, 3)


def test_a_source_with_another_digest_is_rejected(tmp_path, frames):
    """Sources of equal sizes are distinguished by digest; the message names both files and the command that rebuilds."""
    other = source(tmp_path / "other" / "frames.zarr", 1, 2, 4)
    poses = made(tmp_path / "results/adt/one/poses.zarr", 3, {"frames.zarr": frames.digest})
    check_made_from(poses, frames, axes=("frame",))
    with pytest.raises(UserError) as caught:
        check_made_from(poses, other, axes=("frame",))
    said = str(caught.value)
    assert said.startswith(f"{poses.path}: was made from another frames.zarr than {other.path}. ")
    assert said.endswith(f"rm -r {poses.path} && {make_command(poses.path)}")


def test_a_source_that_provenance_does_not_record_is_compared_by_size(tmp_path, frames):
    check_made_from(made(tmp_path / "three.zarr", 3, {}), frames, axes=("frame",))
    poses = made(tmp_path / "poses.zarr", 2, {})
    check_made_from(poses, frames)
    with pytest.raises(UserError, match="poses.zarr: was made from another frames.zarr"):
        check_made_from(poses, frames, axes=("frame",))


def test_every_source_is_checked(tmp_path, frames):
    other = source(tmp_path / "masks.zarr", 5)
    poses = made(tmp_path / "poses.zarr", 3, {"frames.zarr": frames.digest, "masks.zarr": "0"})
    with pytest.raises(UserError, match="another masks.zarr"):
        check_made_from(poses, frames, other)
    check_inputs(tmp_path / "survey.json", {"renamed.zarr": frames.digest}, [frames])
    for recorded in ({"frames.zarr": "0"}, {}):
        with pytest.raises(UserError, match="survey.json: was made from another frames.zarr"):
            check_inputs(tmp_path / "survey.json", recorded, [frames])
