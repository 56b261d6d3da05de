"""``egosplat check`` of the JSON files of results."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.lineage import DOCUMENTS, check_tree
from egosplat.errors import UserError
from tests.support.scenes import put


@pytest.fixture
def surveyed(tmp_path, survey_that_keeps) -> Path:
    """A survey next to the artifact that it was made from."""
    make_artifact(tmp_path)
    survey_that_keeps(tmp_path, [0])
    return tmp_path


def make_artifact(folder: Path, seed: int = 0) -> None:
    """One frame of one grey; only its digest and its attributes' checksum are read."""
    put(folder, "frames", {"rgb": np.full((1, 4, 4, 3), seed, np.uint8)})


def problems(folder: Path) -> dict[str, str]:
    return {path.name: problem for path, problem in check_tree(folder, lambda _: None).items()}


def picture(path: Path) -> None:
    Image.new("RGB", (4, 4)).save(path, format="PNG")


DAMAGE: dict[str, Callable[[Path], object]] = {
    "a picture": picture,
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
    """A scene whose metrics.json is a picture was called sound."""
    path = surveyed / name
    path.unlink(missing_ok=True)
    DAMAGE[damage](path)
    told = problems(surveyed)[name]
    assert str(path) in told and "Rebuild it: " in told


def test_a_survey_of_other_frames_is_a_problem(surveyed):
    assert problems(surveyed) == {"frames.zarr": "", "survey.json": ""}
    make_artifact(surveyed, seed=1)
    assert "was made from another frames.zarr" in problems(surveyed)["survey.json"]


def test_a_folder_without_results_is_an_error(tmp_path):
    (tmp_path / "notes.json").write_text("{}")
    with pytest.raises(UserError, match="no artifact"):
        check_tree(tmp_path, print)
