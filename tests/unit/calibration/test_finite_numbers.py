"""A COLMAP model in text whose numbers are not finite is refused with the file, the line and the number."""

import shutil
from pathlib import Path

import pycolmap
import pytest

from egosplat.calibration.known_poses import read_known_poses
from egosplat.errors import UserError


@pytest.fixture
def text_model(model: pycolmap.Reconstruction, colmap_folder: Path) -> Path:
    shutil.rmtree(colmap_folder)
    colmap_folder.mkdir()
    model.write_text(colmap_folder)
    return colmap_folder


@pytest.mark.parametrize(
    ("name", "column", "number"),
    [("cameras", 4, "nan"), ("images", 6, "-inf"), ("points3D", 1, "NaN"), ("points3D", 7, "Infinity")],
)
def test_the_line_of_a_number_that_is_not_finite_is_named(pictures, text_model, name, column, number):
    path = text_model / f"{name}.txt"
    lines = path.read_text().splitlines()
    at = next(index for index, line in enumerate(lines) if not line.startswith("#"))
    words = lines[at].split()
    words[column] = number
    lines[at] = " ".join(words)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(UserError, match=f"{name}.txt: line {at + 1}: {number} is no finite number"):
        read_known_poses(pictures, "colmap", 64, 48)


def test_a_mean_in_a_comment_may_be_anything(pictures, text_model):
    """COLMAP writes the mean length of no tracks."""
    path = text_model / "points3D.txt"
    path.write_text("# Number of points: 0, mean track length: -nan\n" + path.read_text())
    assert len(read_known_poses(pictures, "colmap", 64, 48).points) == 30
