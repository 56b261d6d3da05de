"""Pictures of a lens with distortion become pictures of a pinhole camera, without blank pixels."""

import numpy as np
import pytest

from egosplat.calibration.lens import Lens, Rectifier
from egosplat.errors import UserError
from egosplat.geometry import Camera

WIDTH, HEIGHT = 96, 72
PINHOLE = (80.0, 82.0, 47.0, 37.0)
DISTORTED = {
    "pincushion": Lens("OPENCV", WIDTH, HEIGHT, (*PINHOLE, 0.1, 0.02, 0.001, -0.002)),
    "barrel": Lens("RADIAL", WIDTH, HEIGHT, (80.0, 47.0, 37.0, -0.2, 0.03)),
    "fisheye": Lens("OPENCV_FISHEYE", WIDTH, HEIGHT, (*PINHOLE, 0.01, 0.0, 0.0, 0.0)),
}


def picture_of(lens: Lens) -> np.ndarray:
    """A picture whose red and green are the direction of each pixel's ray."""
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = lens.colmap().cam_from_img(np.stack([columns, rows], -1).reshape(-1, 2))
    values = np.clip(127 + 100 * rays, 0, 255).reshape(lens.height, lens.width, 2)
    return np.dstack([values, np.zeros((lens.height, lens.width))]).round().astype(np.uint8)


@pytest.mark.parametrize("lens", DISTORTED.values(), ids=DISTORTED)
def test_a_rectified_pixel_shows_the_ray_of_the_pinhole_camera(lens):
    camera = lens.pinhole
    shown = Rectifier(lens).image(picture_of(lens)).astype(float)
    x = (np.arange(WIDTH) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(HEIGHT) + 0.5 - camera.cy) / camera.fy
    expected = 127 + 100 * np.stack(np.meshgrid(x, y), -1)
    inside = (expected > 0) & (expected < 255)
    assert np.abs(shown[..., :2] - expected)[inside].max() <= 1.1


@pytest.mark.parametrize("lens", DISTORTED.values(), ids=DISTORTED)
def test_no_rectified_pixel_is_blank_and_two_sides_touch_the_border(lens):
    everywhere = np.ones((HEIGHT, WIDTH), bool)
    assert Rectifier(lens).mask(everywhere).all()
    camera, full = lens.pinhole, lens.colmap()
    x, y = np.linspace(0.5, WIDTH - 0.5, 50), np.linspace(0.5, HEIGHT - 0.5, 50)
    sides = [(x, np.full(50, 0.5)), (x, np.full(50, HEIGHT - 0.5)), (np.full(50, 0.5), y)]
    sides.append((np.full(50, WIDTH - 0.5), y))
    gaps = []
    for u, v in sides:
        rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(50)], -1)
        shown = full.img_from_cam(rays)
        border = np.stack([shown, [WIDTH, HEIGHT] - shown]).min(axis=(0, 2))
        assert border.min() > -0.1
        gaps.append(border.min())
    assert sorted(gaps)[1] < 1.5


def test_a_lens_without_distortion_changes_nothing():
    lens = Lens("OPENCV", WIDTH, HEIGHT, (*PINHOLE, 0.0, 0.0, 0.0, 0.0))
    picture = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    assert lens.pinhole == Camera(WIDTH, HEIGHT, *PINHOLE)
    assert Rectifier(lens).image(picture) is picture
    assert not Lens("OPENCV_FISHEYE", WIDTH, HEIGHT, (*PINHOLE, 0.0, 0.0, 0.0, 0.0)).is_pinhole


@pytest.mark.parametrize("lens", DISTORTED.values(), ids=DISTORTED)
def test_labels_and_masks_follow_the_picture(lens):
    labels = (np.arange(WIDTH)[None] // 8 + 20 * (np.arange(HEIGHT)[:, None] // 8)).astype(np.int32)
    rectifier = Rectifier(lens)
    picture = np.repeat(labels[..., None], 3, axis=2).astype(np.uint8)
    agree = rectifier.labels(labels) == rectifier.image(picture)[..., 0]
    assert agree.mean() > 0.7
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[30:40, 40:60] = False
    shown = rectifier.mask(mask)
    assert 0 < (~shown).sum() < 1000 and not shown[rectifier.labels((~mask).astype(np.int32)) > 0].any()


@pytest.mark.parametrize(
    "lens, problem",
    [
        (Lens("RADIAL", 96, 72, (80.0, 47.0, 37.0, float("nan"), 0.0)), "finite"),
        *((Lens("RADIAL", 96, 72, (f, 47.0, 37.0, 0.0, 0.0)), "in pixels") for f in (0.0, 9.5, 2881.0)),
        (Lens("PINHOLE", 96, 72, (30.0, 91.0, 47.0, 37.0)), "at most 3 times"),
        (Lens("RADIAL", 96, 72, (80.0, 47.0, 37.0, 200.0, 0.0)), "magnifies"),
        (Lens("RADIAL", 96, 72, (80.0, 97.0, 37.0, 0.0, 0.0)), r"\(cx, cy\) inside"),
        (Lens("RADIAL", 96, 72, (80.0, 47.0, 37.0, -2.0, 0.0)), "RADIAL lens .*folds"),
        (Lens("OPENCV_FISHEYE", 96, 72, (25.0, 25.0, 47.0, 37.0, *[0.0] * 4)), "FISHEYE lens .*too wide"),
    ],
)
def test_an_impossible_camera_is_named(lens, problem):
    with pytest.raises(UserError, match=f"here.json: .*{problem}"):
        lens.check("here.json")
