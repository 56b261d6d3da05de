"""Training starts at the visible points, within the budget, and at one in each valid cell without points, at a plausible depth."""

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.gaussians.initialization import CELLS, densify, starting_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.training_views import Views, read_views
from egosplat.geometry import Camera
from tests.support.gaussian_scene import SETTINGS

CAMERA = Camera(96, 48, 60.0, 60.0, 48.0, 24.0)
POSE = np.eye(4)
ALL = np.ones((48, 96), bool)


def wall(depth: float, left_half: bool) -> tuple[np.ndarray, np.ndarray]:
    """A point in the middle of every cell, or of those of the left half alone."""
    side = 96 / CELLS
    columns, rows = np.meshgrid(np.arange(CELLS) + 0.5, np.arange(CELLS // 2) + 0.5)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1) * side
    if left_half:
        pixels = pixels[pixels[:, 0] < 48]
    rays = (pixels - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy)
    return np.column_stack([rays, np.ones(len(rays))]) * depth, np.zeros((len(rays), 3), np.uint8)


def picture() -> np.ndarray:
    """One whose pixels tell their column and row."""
    rows, columns = np.mgrid[:48, :96]
    return np.stack([columns, rows, np.full_like(rows, 7)], axis=-1).astype(np.uint8)[None]


def cover(xyz, rgb, poses=POSE[None], valid=ALL):
    shown = torch.from_numpy(np.concatenate([picture()] * len(poses)))
    weight = torch.from_numpy(valid).float()
    views = Views(np.arange(len(poses)), shown, poses, weight, None, CAMERA, torch.device("cpu"))
    return densify(xyz, rgb, views, 0.1)


VALID = ALL.copy()
VALID[:, 48:] = False


@pytest.mark.parametrize(
    ("xyz", "valid"),
    [
        (wall(3.0, left_half=False)[0], ALL),
        (wall(3.0, left_half=True)[0], VALID),
        *((np.array([behind]), ALL) for behind in ([0, 0, -2.0], [0, 0, 0.05])),
    ],
    ids=["points everywhere", "elsewhere no valid pixel", "behind", "before the near plane"],
)
def test_nothing_is_added(xyz, valid):
    rgb = np.full(xyz.shape, 9, np.uint8)
    every, colors = cover(xyz, rgb, valid=valid)
    np.testing.assert_array_equal(every, xyz)
    np.testing.assert_array_equal(colors, rgb)


def test_empty_cells_get_a_point_at_the_neighboring_depth_in_the_image_s_color():
    xyz, rgb = wall(3.0, left_half=True)
    every, colors = cover(xyz, rgb)
    new, shown = every[len(xyz) :], colors[len(xyz) :]
    assert len(new) == CELLS * CELLS // 4
    np.testing.assert_allclose(new[:, 2], 3.0)
    pixels = CAMERA.project(new)
    assert (pixels[:, 0] >= 48).all()
    np.testing.assert_allclose(shown[:, :2], pixels, atol=1.0)
    # The points of one photograph count for the next.
    assert len(cover(xyz, rgb, np.stack([POSE, POSE]))[0]) == len(every)


def test_without_points_they_are_anywhere_in_what_a_view_shows():
    every, _ = cover(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert len(every) == CELLS * CELLS // 2 and 0.1 < every[:, 2].min() < 1 and 2.5 < every[:, 2].max() < 3.2


def test_the_nearest_cell_s_median_decides():
    xyz, rgb = wall(3.0, left_half=True)
    nearer = np.concatenate([xyz, xyz * 2, xyz * 2.5])
    every, _ = cover(nearer, np.concatenate([rgb] * 3))
    np.testing.assert_allclose(every[len(nearer) :, 2], 6.0)


@pytest.fixture
def start(scene, points):
    """``start(densify_init, max_points)``: Gaussians of the wall, of whose left half alone points are known."""
    left = points[0][:, 0] < 0
    folder = scene(**{"points/xyz": points[0][left], "points/rgb": points[1][left]})
    frames, poses = open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)
    views = read_views(frames, poses, np.ones(9, bool), torch.device("cpu"))

    def make(densify_init: bool, max_points: int, seed: int = 0) -> Gaussians:
        keys = {"max_points": max_points, "densify_init": densify_init, "seed": seed}
        few = {"iterations": 1, "evaluate_every": 1, "max_gaussians": 1000}
        return starting_gaussians(poses, views, TrainingOptions(render=SETTINGS, **few, **keys))

    return make


def test_densify_init_adds_gaussians_where_no_point_is_known(start):
    known, covered = start(False, 1000), start(True, 1000)
    assert float(known.means[:, 0].max()) < 0
    torch.testing.assert_close(covered.means[: known.count], known.means)
    new = covered.means[known.count :]
    assert int((new[:, 0] > 0.3).sum()) > 30
    assert 1.7 < float(new[:, 2].min()) and float(new[:, 2].max()) < 2.3


@pytest.mark.parametrize("most", [8, 30, 100])
def test_never_more_than_the_budget_and_half_of_it_for_known_points(start, most):
    every, known = start(True, most).means, start(False, 1000).means
    assert len(every) == most
    kept = (every[:, None] == known).all(dim=-1).any(dim=1).sum()
    assert int(kept) >= min(most // 2, len(known))
