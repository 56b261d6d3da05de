"""The page of what moves is drawn from whatever its artifacts hold, and shows what it says."""

from dataclasses import asdict

import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.report.sheets.transient_sheet import LABELS, MOVING, PICTURES, choose_frames
from tests.support.scenes import put_scene

HEIGHT, WIDTH = 20, 30
CAMERA = Camera(WIDTH, HEIGHT, 20.0, 20.0, 15.0, 10.0)
NAMES = ("frames", "poses", "transient", "instances", "masks", "splats")
OPTIONS = {"near_plane": 0.1, "antialiased": False, "background": "black", "masking": "refined"}


def scene(folder, frames: int, instances: int, moving: int, digests: bool = False):
    """The first ``moving`` instances move, in all frames but the last; with ``digests``, inputs are recorded."""
    rng, count = np.random.default_rng(0), 6
    labels = np.full((frames, 2, HEIGHT, WIDTH), -1, np.int32)
    for instance in reversed(range(instances)):
        row = 2 * (instance % 10)  # what moves covers what stays
        labels[: frames - (instance < moving), instance % 2, row : row + 2, 2:25] = instance
    moves = np.arange(instances) < moving
    arrays = {
        "rgb": np.full((frames, HEIGHT, WIDTH, 3), 100, np.uint8),
        "registered": np.ones(frames, bool),
        "intrinsics": CAMERA.matrix,
        "probability": rng.random((frames, HEIGHT, WIDTH)).astype(np.float16),
        "labels": labels,
        "instances/level": (np.arange(instances) % 2).astype(np.int8),
        "refined": np.append(moves, False)[labels].any(axis=1),
        "instances/score": np.where(moves, 0.9, 0.1).astype(np.float32),
        "instances/transient": moves,
        "means": (rng.normal(size=(count, 3)) + [0, 0, 4]).astype(np.float32),
        "log_scales": np.full((count, 3), -1.0, np.float32),
        "logit_opacities": np.full(count, 4.0, np.float32),
        "sh": np.tile(np.float32([-1.5, 1.5, -1.5]), (count, 1, 1)),
    }
    facts = {"levels": ["part", "whole"], "threshold": 0.5, "instances": instances}
    facts |= {"transient": moving, "masked_share": float(arrays["refined"].mean())}
    facts |= {"camera": asdict(CAMERA), "sh_degree_in_use": 0}
    return put_scene(folder, NAMES, arrays, facts, chained=digests, options=OPTIONS, origin="real")


def count(picture: np.ndarray, low: list[int], high: list[int]) -> int:
    """Pixels whose color lies in a box."""
    return int(((picture >= low) & (picture <= high)).all(axis=2).sum())


@pytest.mark.parametrize(
    "frames, instances, moving",
    [(12, 6, 3), (1, 1, 0), (2, 0, 0), (2, 100, 95)],
    ids=["usual", "one that stays", "no instance", "more bars than are named"],
)
def test_the_page_is_written_as_one_picture(tmp_path, draw, frames, instances, moving):
    picture = draw("transient_sheet", scene(tmp_path, frames, instances, moving))
    assert picture.shape[1] > 700 and picture.std() > 10
    crimson = count(picture, [215, 15, 55], [225, 25, 65])  # bars of what moves
    assert (crimson > 2000) == (moving > 0)
    tinted = count(picture, [146, 66, 82], [150, 70, 86])  # crimson over the grey of the photographs
    assert (tinted > 2000) == (moving > 0)
    assert count(picture, [0, 180, 0], [100, 255, 100]) > 500  # the Gaussians are green


def test_mismatched_artifacts_are_rejected(tmp_path, draw):
    paths, other = [], []
    for folder, found, frames in ((tmp_path / "one", paths, 1), (tmp_path / "two", other, 2)):
        folder.mkdir()
        found += scene(folder, frames, 2, 1, digests=True)
    for index in (3, 4, 5):
        with pytest.raises(UserError, match=f"two/{NAMES[index]}.zarr: was made from another"):
            draw("transient_sheet", [*paths[:index], other[index], *paths[index + 1 :]])
    with pytest.raises(UserError, match=r"masks\.zarr"):
        draw("transient_sheet", [*paths[:4], tmp_path / "masks.zarr", paths[5]])
    assert not list(tmp_path.glob("*.png"))


def test_frames_where_most_is_masked_spread_in_time_and_one_where_nothing_is():
    masked = np.zeros(100)
    masked[10:90] = 0.1
    masked[[20, 44, 56, 70, 88]] = 0.5, 0.3, 0.4, 0.6, 0.9
    shown = choose_frames(masked, np.ones(100, bool))
    assert {20, 44, 56} <= set(shown) and 88 not in shown  # 88 ends its part
    assert len(shown) == PICTURES and shown == sorted(shown)
    assert sum(masked[shown] == 0) == PICTURES - MOVING
    assert not {20, 44} & set(choose_frames(masked, ~np.isin(np.arange(100), [20, 44])))


@pytest.mark.parametrize(
    "masked, expected",
    [
        ([0.0, 0.0, 0.0], [0, 1, 2]),
        ([0.2, 0.1], [0, 1]),
        ([0.0, 0.3, 0.0, 0.0], [0, 1, 2, 3]),
        ([0.0] * 10, [0, 2, 4, 7, 9]),
        ([0.2] * 40, [2, 12, 22, 32]),
        ([], []),
    ],
)
def test_frames_chosen_when_much_or_nothing_moves(masked, expected):
    assert choose_frames(np.array(masked), np.ones(len(masked), bool)) == expected


def test_the_largest_of_what_moves_are_named(tmp_path, draw, drawn):
    draw("transient_sheet", scene(tmp_path, 3, 9, 6))
    named = [[text.get_text() for text in axes.texts] for axes in drawn[0].get_axes()]
    assert [len(names) for names in named if names] == [LABELS] * 2
    assert {name.partition(":")[0] for names in named for name in names} <= set("012345")
