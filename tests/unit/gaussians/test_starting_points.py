"""Training starts at the visible points, within the budget."""

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.gaussians.initialization import starting_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import read_views


@pytest.fixture
def start(scene, points):
    """``start(densify_init, max_points)``: Gaussians of the wall, of whose left half alone points are known."""
    left = points[0][:, 0] < 0
    folder = scene(**{"points/xyz": points[0][left], "points/rgb": points[1][left]})
    frames, poses = open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)
    views = read_views(frames, poses, np.ones(9, bool), torch.device("cpu"))

    def make(densify_init: bool, max_points: int, seed: int = 0) -> Gaussians:
        keys = {"sh_degree": 0, "near_plane": 0.1, "seed": seed}
        return starting_gaussians(poses, views, max_points=max_points, densify_init=densify_init, **keys)

    return make


def test_without_densify_init_gaussians_start_at_the_points(start):
    assert float(start(False, 1000).means[:, 0].max()) < 0


def test_densify_init_adds_gaussians_where_no_point_is_known(start):
    known, covered = start(False, 1000), start(True, 1000)
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
