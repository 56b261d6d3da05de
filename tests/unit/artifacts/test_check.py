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
    assert problems(surveyed) == {"frames.zarr": "", "survey.json": ""}
    put(surveyed, "frames", {"rgb": np.ones((4, 4, 4, 3), np.uint8)}, size=4)
    assert "was made from another frames.zarr" in problems(surveyed)["survey.json"]
    with pytest.raises(UserError, match="no artifact"):
        check_tree(tmp_path_factory.mktemp("nothing"), print)
