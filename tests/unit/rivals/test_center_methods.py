"""Semantic Gaussians and Occam's LGS: what their definitions say, in scenes of few Gaussians."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera
from egosplat.language.targets import Targets
from egosplat.language.views import CodeViews
from egosplat_rivals.occam import average_at_centers
from egosplat_rivals.semantic_gaussians import EVERY, pixel_features, project_views
from egosplat_rivals.splat_feature_solver import lift
from tests.support.gaussian_scene import SETTINGS
from tests.support.splats import blobs

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
LEFT, RIGHT = [1.0, 0.0], [0.0, 1.0]


@dataclass
class Painted:
    """Stands for ``CodeTargets``: (F, L, C, H, W) codes; a pixel whose codes are all 0 has none."""

    codes: torch.Tensor

    def __post_init__(self) -> None:
        _, levels, self.channels, *_ = self.codes.shape
        self.levels = [f"level {number}" for number in range(levels)]

    def of(self, frame: int) -> Targets:
        return Targets(self.codes[frame], (self.codes[frame] != 0).any(1))

    def at(self, frame: int, pixels: np.ndarray) -> Targets:
        whole = self.of(frame)
        columns, rows = torch.from_numpy(pixels).unbind(1)
        return Targets(whole.codes[..., rows, columns], whole.known[:, rows, columns])


def painted(frames=1, levels=1, left=LEFT, right=RIGHT) -> Painted:
    codes = torch.zeros(frames, levels, 2, CAMERA.height, CAMERA.width)
    codes[..., :32], codes[..., 32:] = (torch.tensor(one)[:, None, None] for one in (left, right))
    return Painted(codes)


def look(gaussians: Gaussians, targets: Painted, poses: np.ndarray | None = None) -> CodeViews:
    count = len(targets.codes)
    poses = np.tile(np.eye(4), (count, 1, 1)) if poses is None else poses
    given = np.arange(count), torch.empty(count, 0), poses, None, None, CAMERA, gaussians.means.device
    return CodeViews(*given, gaussians=gaussians, settings=SETTINGS, targets=targets.of)


def code_of(method, gaussians: Gaussians, targets: Painted, views: CodeViews | None = None):
    found = method(views or look(gaussians, targets), targets)
    assert bool(found.code.isfinite().all()) and found.levels
    return found.code, found.share


def plane(z: float, x: float = 0.0, opacity: float = 0.98) -> Gaussians:
    """A dense patch of Gaussians in front of the camera, one of them at the column ``x``."""
    side = torch.linspace(-0.3, 0.3, 7) * z / 2
    grid = torch.cartesian_prod(side + x, side)
    means = torch.cat([grid, torch.full((len(grid), 1), z)], 1)
    return blobs(means.tolist(), [opacity] * len(means), size=0.06 * z / 2)


def test_a_hidden_plane_gets_nothing_and_without_the_depth_test_the_front_s_feature(monkeypatch):
    both = Gaussians.concatenate([plane(2.0), plane(4.0)])
    code, share = code_of(project_views, both, painted(left=RIGHT))
    front = both.count // 2
    assert bool((share[:front] == 1).all()) and not share[front:].any() and not code[front:].any()
    monkeypatch.setattr("egosplat_rivals.semantic_gaussians.TOLERANCE", 1e9)
    code, share = code_of(project_views, both, painted(left=RIGHT))
    torch.testing.assert_close(code[:, 0], torch.tensor(RIGHT).expand(both.count, 2))


def test_every_fifth_view_is_projected_and_views_without_a_mask_shorten_the_mean():
    """Views 0, 5 and 10 of 12, the last of them without a mask: the mean of two unit features and a 0 is not normalized."""
    targets = painted(frames=12, left=[0.0, 0.0], right=[0.0, 0.0])
    targets.codes[[0, 5], :, 0] = 1.0
    targets.codes[[1, 4, 6, 11], :, 1] = 1.0
    code, share = code_of(project_views, plane(2.0), targets)
    torch.testing.assert_close(code[:, 0], torch.tensor([2 / 3, 0.0]).expand(len(code), 2))
    assert EVERY == 5 and bool((share == 1).all())


def test_a_pixel_under_two_masks_has_the_unit_sum_of_their_features():
    codes = torch.tensor([[[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [4.0, 2.0, 0.0]]])
    torch.testing.assert_close(pixel_features(codes), torch.tensor([[0.6, 0.8], [0.0, 1.0], [0.0, 0.0]]))


def at_column(column: float, z: float = 2.0) -> list[float]:
    return [(column + 0.5 - 32.0) / 60.0 * z, 0.0, z]


@pytest.mark.parametrize(
    "means, opacities, seen",
    [
        # A lone one that is faint has no median depth.
        ([at_column(35)], [0.4], [0.0]),
        ([at_column(35)], [0.9], [1.0]),
        # The depth test is 5 percent of the surface's depth.
        ([at_column(35), at_column(35, 2.0 * 1.049)], [0.9, 0.3], [1.0, 1.0]),
        ([at_column(35), at_column(35, 2.0 * 1.051)], [0.9, 0.3], [1.0, 0.0]),
        # 10 of 648 pixels are 0.99 px here: the outermost column does not count.
        ([at_column(column) for column in (0, 1, 62, 63)], [0.9] * 4, [0.0, 1.0, 1.0, 0.0]),
    ],
)
def test_gaussians_are_seen_at_the_surface_and_away_from_the_border(means, opacities, seen):
    _, share = code_of(project_views, blobs(means, opacities, size=0.02), painted())
    assert share[:, 0].tolist() == seen


@pytest.mark.parametrize("method", [project_views, average_at_centers])
def test_gaussians_out_of_the_image_and_the_lens_circle_get_no_code(method):
    means = [[0.0, 0.0, -2.0], [5.0, 0.0, 2.0], [-0.4, 0.0, 2.0], [0.4, 0.0, 2.0]]
    lost, targets = blobs(means, [0.9] * 4, size=0.05), painted()
    valid = torch.ones(CAMERA.height, CAMERA.width)
    valid[:, :32] = 0.0
    code, share = code_of(method, lost, targets, replace(look(lost, targets), valid=valid))
    assert share[:, 0].tolist() == [0.0, 0.0, 0.0, 1.0] and not code[:3].any()


def test_a_gaussian_across_two_segments_takes_the_one_at_its_center_and_lifting_mixes():
    large = blobs([[0.05, 0.0, 2.0]], [0.9], size=0.3)
    targets = painted()
    code, _ = code_of(average_at_centers, large, targets)
    torch.testing.assert_close(code[0, 0], torch.tensor(RIGHT))
    mixed = lift(look(large, targets))[0][0, 0]
    assert float(mixed.min()) > 0.3


def test_occam_s_mean_is_weighted_by_what_each_view_shows_at_the_center():
    """A second view lies behind a Gaussian of opacity 0.5, so that it counts half."""
    pair = blobs([[0.0, 0.0, 2.0], [0.0, 0.0, 5.0]], [0.5, 0.8], size=0.3)
    beyond = np.eye(4)
    beyond[2, 3] = 3.0
    targets = painted(frames=2)
    targets.codes[0, 0], targets.codes[1, 0] = (torch.tensor(one)[:, None, None] for one in (LEFT, RIGHT))
    views = look(pair, targets, np.stack([np.eye(4), beyond]))
    code, share = code_of(average_at_centers, pair, targets, views)
    torch.testing.assert_close(code[1, 0], torch.tensor([1 / 3, 2 / 3]), atol=0.01, rtol=0)
    torch.testing.assert_close(code[0, 0], torch.tensor(LEFT))
    assert share[:, 0].tolist() == [1.0, 1.0]


def test_views_without_a_mask_at_the_center_do_not_count_in_occam_s_mean():
    targets = painted(frames=2, levels=2, left=RIGHT)
    targets.codes[1, 0] = targets.codes[:, 1] = 0.0
    code, share = code_of(average_at_centers, blobs([[0.1, 0.0, 2.0]], [0.9]), targets)
    torch.testing.assert_close(code[0], torch.tensor([RIGHT, [0.0, 0.0]]))
    assert share.tolist() == [[1.0, 0.0]]
