"""The page of what Gaussians mean is drawn from whatever its artifacts hold, and shows what it says."""

from dataclasses import asdict

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera
from egosplat.report.sheets.language_sheet import UNKNOWN, blend, code_colors
from tests.support.scenes import LEVELS, put_scene

CAMERA = Camera(36, 24, 18.0, 18.0, 18.0, 12.0)
OPTIONS = {"near_plane": 0.1, "antialiased": False, "background": "black"}


def scene(folder, channels: int, share: float):
    """Green Gaussians all around; the first level has a meaning, the second has none."""
    rng, count = np.random.default_rng(0), 60
    around = rng.normal(size=(count, 3)) * [1.0, 0.3, 1.0]
    poses = np.tile(np.eye(4), (7, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("y", 60 * np.arange(7)[:, None], degrees=True).as_matrix()
    shares = np.tile(np.float32([share, 0]), (count, 1))
    code = rng.normal(size=(count, 2, channels)).astype(np.float32) * (shares[..., None] > 0)
    arrays = {
        "registered": np.arange(7) > 0,
        "camera_to_world": poses,
        "intrinsics": CAMERA.matrix,
        "means": (3.0 * around / np.linalg.norm(around, axis=1, keepdims=True)).astype(np.float32),
        "log_scales": np.full((count, 3), -0.7, np.float32),
        "logit_opacities": np.full(count, 5.0, np.float32),
        "sh": np.tile(np.float32([-1.5, 1.5, -1.5]), (count, 1, 1)),
        "code": code,
        "share": shares,
    }
    facts = {"levels": LEVELS, "method": "lifted", "camera": asdict(CAMERA), "sh_degree_in_use": 0}
    names, made = ["poses", "splats", "language"], {"stage": "frames", "options": OPTIONS, "origin": "real"}
    return put_scene(folder, names, arrays, facts, chained=True, **made)


@pytest.mark.parametrize("channels, share", [(5, 1.0), (2, 0.6), (1, 1.0), (4, 0.0)])
def test_the_page_is_written_as_one_picture(tmp_path, draw, channels, share):
    picture = draw("language_sheet", scene(tmp_path, channels, share))
    height, width, _ = picture.shape
    assert width > 1000
    cells = picture[height // 8 :].reshape(-1, 3)
    green = (cells[:, 1] > 180) & (cells[:, [0, 2]].max(axis=1) < 60)
    assert green.sum() > 5000
    # The level without a meaning is grey; the other, where it has one, is of other colors.
    grey = (np.abs(cells - 255 * UNKNOWN).max(axis=1) < 2).sum() / (height * width)
    assert (0.2 < grey < 0.4) if share else grey > 0.4


def codes(count: int, *scales: float) -> np.ndarray:
    """(count, 1, C) float32 with standard deviations ``scales`` along the axes."""
    rng = np.random.default_rng(0)
    return (rng.normal(size=(count, 1, len(scales))) * scales + 7.0).astype(np.float32)


def painted(code: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(N, 3) colors of the first level."""
    return blend(code_colors(code, share)[:, 0], np.ones(len(code), np.float32))


def test_red_green_and_blue_are_the_first_three_components():
    code = codes(4000, 0.1, 3.0, 0.01, 1.0, 0.3)
    colors = painted(code, np.ones((4000, 1), np.float32))
    for channel, axis in enumerate((1, 3, 4)):
        assert np.corrcoef(colors[:, channel], code[:, 0, axis])[0, 1] > 0.97
    np.testing.assert_allclose(colors.mean(axis=0), 0.5, atol=0.01)
    # Two standard deviations reach to the ends: uniform enough to be told apart, and little is cut off.
    assert 0.2 < colors.std(axis=0).min() and (colors == 1).mean() < 0.05


def test_codes_weigh_by_their_share():
    code = codes(200, 1.0, 0.1)
    share = np.ones((200, 1), np.float32)
    code[100:] += 50.0
    share[100:] = 1e-6
    np.testing.assert_allclose(painted(code, share)[:100].mean(axis=0)[:2], 0.5, atol=0.05)
    repeated = np.concatenate([code[:100], code[:100], code[100:]])
    twice = np.concatenate([np.full((200, 1), 0.5), share[100:]]).astype(np.float32)
    np.testing.assert_allclose(painted(repeated, twice)[:100], painted(code, share)[:100], atol=1e-6)


def test_a_code_has_one_color_at_all_levels_and_half_covered_pixels_are_half_gray():
    code = np.repeat(codes(50, 1.0, 0.5, 0.2), 2, axis=1)
    code[:, 1] += np.float32(2.0)
    both = code_colors(code, np.ones((50, 2), np.float32))
    flat = code_colors(code.reshape(100, 1, 3), np.ones((100, 1), np.float32))
    np.testing.assert_allclose(both.reshape(100, 1, 3), flat, atol=1e-6)
    full, half, none = blend(np.tile([9.0, 0.5, 0.0], (3, 1)), np.float32([1.0, 0.5, 0.0]))
    assert full.tolist() == [1.0, 0.5, 0.0] and none.tolist() == [UNKNOWN] * 3
    np.testing.assert_allclose(half, (full + none) / 2)


@pytest.mark.parametrize(
    "count, code, share", [(0, 0, 0), (5, 1, 1), (5, 0, 0)], ids=["no Gaussian", "one code", "no meaning"]
)
def test_codes_that_do_not_differ_have_the_middle_color(count, code, share):
    given = np.full((count, 2, 4), code, np.float32), np.full((count, 2), share, np.float32)
    assert np.abs(code_colors(*given) - 0.5).max(initial=0) < 1e-6
