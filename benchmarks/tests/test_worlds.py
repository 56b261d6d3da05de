"""Benchmarks of held-out worlds run whole on a small one."""

import re

import pytest
from click.testing import CliRunner

from benchmarks.single_frames import __main__ as single_frames
from benchmarks.small_open_clip import __main__ as small_open_clip
from benchmarks.small_sam2 import __main__ as small_sam2
from egosplat.models.checkpoints import SMALL_CLIP
from tests.support.tables import cells
from training.small_models.crops import cut_world
from training.small_models.worlds import HELD_OUT_SEEDS, ClipSettings, render_world

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def worlds(tmp_path_factory):
    """A folder with one world of six frames."""
    folder = tmp_path_factory.mktemp("worlds")
    render_world(HELD_OUT_SEEDS, ClipSettings(size=96, clips=1, frames=6, step_s=0.2), folder / "1000")
    return folder


def run(command, *words) -> str:
    done = CliRunner().invoke(command, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_single_frames_are_segmented_and_scored(worlds):
    said = run(single_frames.main, worlds, "-s", "points_per_side=6,crops_per_side=1")
    rows = [row for row in cells(said) if row[0].startswith("points_per_side")]
    assert [row[1] for row in rows] == ["whole", "part", "subpart"]
    assert all(float(row[-2]) > 0 for row in rows) and any(0 < float(row[5]) <= 1 for row in rows)


def test_both_segmenters_answer_points_and_track(worlds):
    said = run(small_sam2.main, worlds, "--stills", 1, "--tracks", 2, "--processes", 1)
    rows = {row[0]: row[1:] for row in cells(said)}
    assert rows[""] == ["results", "small SAM2", "classical"]
    tracks, *scores = rows["J, all tracks"]
    assert int(tracks) == 2 and all(0 < float(score) <= 1 for score in scores)


def test_crops_are_named(worlds, tmp_path):
    cut_world(worlds / "1000", tmp_path / "1000.npz")
    said = run(small_open_clip.main, tmp_path, SMALL_CLIP)
    count = int(re.match(r"(\d+) crops of 1 held-out worlds", said)[1])
    kinds = {row[0]: row[1:] for row in cells(said)}
    assert {"masked crop", "unmasked square", "tile"} <= set(kinds)
    assert 0 < int(kinds["masked crop"][-1].replace(",", "")) <= count
