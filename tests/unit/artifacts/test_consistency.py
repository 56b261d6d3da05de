"""``egosplat check`` of JSON files; artifacts that do not belong together are refused, by digest and by size."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.consistency import check_inputs, check_made_from
from egosplat.artifacts.lineage import DOCUMENTS, check_tree
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.pipeline.home import make_command
from tests.support.scenes import put


@pytest.fixture
def surveyed(tmp_path, survey_that_keeps) -> Path:
    """A survey next to the artifact that it was made from."""
    put(tmp_path, "frames", size=4)
    survey_that_keeps(tmp_path, [0])
    return tmp_path


def problems(folder: Path) -> dict[str, str]:
    return {path.name: problem for path, problem in check_tree(folder, lambda _: None).items()}


DAMAGE: dict[str, Callable[[Path], object]] = {
    "a picture": lambda path: Image.new("RGB", (4, 4)).save(path, format="PNG"),
    "an empty file": lambda path: path.write_bytes(b""),
    "half of it": lambda path: path.write_text('{"format_version": 1, "scores": {'),
    "a list": lambda path: path.write_text("[]"),
    "another object": lambda path: path.write_text('{"format_version": 1}'),
    "no text": lambda path: path.write_bytes(b"\xff\xfe\x00"),
    "a folder": lambda path: path.mkdir(),
    "a pipe": os.mkfifo,
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_json_file_that_egosplat_did_not_write_is_not_sound(surveyed, name, damage):
    path = surveyed / name
    path.unlink(missing_ok=True)
    DAMAGE[damage](path)
    told = problems(surveyed)[name]
    assert str(path) in told and "Rebuild it: " in told


def test_a_survey_of_other_frames_is_a_problem_and_no_result_an_error(surveyed, tmp_path_factory):
    (link := tmp_path_factory.mktemp("results") / "adt").symlink_to(surveyed)
    assert problems(surveyed) == problems(link.parent) == {"frames.zarr": "", "survey.json": ""}
    put(surveyed, "frames", {"rgb": np.ones((4, 4, 4, 3), np.uint8)}, size=4)
    assert "was made from another frames.zarr" in problems(surveyed)["survey.json"]
    with pytest.raises(UserError, match="no artifact"):
        check_tree(tmp_path_factory.mktemp("nothing"), print)


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
