"""Motion blur and rolling shutter against the geometry of a straight edge."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.frames.rectify import pinhole
from egosplat.geometry import make_pose
from egosplat_apartments.camera.filming import MOST, integrate
from egosplat_apartments.camera.lens import pinhole_lens
from egosplat_apartments.camera.lighting import Lights
from egosplat_apartments.camera.raycasting import Body, build_geometry
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.objects.shapes import Part, box, sheet
from egosplat_apartments.objects.textures import make_texture

SIZE = 96
CAMERA = pinhole(SIZE)
DARK = Lights(np.array([0, -50, 0], np.float32), np.array([0, 1, 0], np.float32), ())
WHITE = make_texture(np.ones((16, 16, 3)), 1.0)
BLACK = make_texture(np.zeros((16, 16, 3)), 1.0)
DOWN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def half_white(bodies=()):
    floor = Part("floor", sheet((-9, 0, -9), (18, 0, 0), (0, 0, 18)), BLACK)
    shine = Part("shine", sheet((-9, 0.01, -9), (9, 0, 0), (0, 0, 18)), WHITE, glow=0.3)
    all_bodies = [Body(1, (floor, shine), np.eye(4), "static"), *bodies]
    return Renderer(build_geometry(all_bodies), DARK, pinhole_lens(CAMERA), np.random.default_rng(0))


def turning(rate):
    def poses(times):
        turns = Rotation.from_rotvec(np.outer(rate * times, [0, 1, 0])).as_matrix()
        return make_pose(DOWN @ turns, np.tile([0, 2.0, 0], (len(times), 1)))

    return poses


def still(time):
    return {}


def image(renderer, radiance):
    values = np.zeros((SIZE, SIZE))
    values[renderer.lens.valid] = radiance[:, 1]
    return values / values.max()


def edges(renderer, radiance, rows):
    return 20 + image(renderer, radiance)[rows, 20:76].sum(axis=1)


@pytest.fixture(scope="module")
def renderer():
    return half_white()


@pytest.fixture(scope="module")
def sharp(renderer):
    return renderer.radiance(turning(0.0)(np.zeros(1))[0], {})


def test_a_still_camera_has_no_blur(renderer, sharp):
    light = integrate(renderer, turning(0.0), still, 0.009, 0.0)
    assert np.array_equal(light, sharp)
    rolled = integrate(renderer, turning(0.0), still, 0.009, 0.005)
    assert np.allclose(rolled, light, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("pixels", [3.0, 6.0])
def test_the_blur_is_as_long_as_speed_times_exposure_and_averages_light(renderer, sharp, pixels):
    exposure_s = 0.01
    light = integrate(renderer, turning(pixels / CAMERA.fx / exposure_s), still, exposure_s, 0.0)

    def variance(radiance):
        slope = -np.diff(image(renderer, radiance)[40:56, 30:66].mean(axis=0))
        columns = np.arange(len(slope))
        return (slope * columns**2).sum() / slope.sum() - ((slope * columns).sum() / slope.sum()) ** 2

    # N equal steps have the variance of a box, but for a share of 1 / N².
    assert np.sqrt(12 * (variance(light) - variance(sharp))) == pytest.approx(pixels, rel=0.1)
    assert edges(renderer, light, slice(40, 56)).mean() == pytest.approx(CAMERA.cx, abs=0.3)
    assert light.mean() == pytest.approx(sharp.mean(), rel=0.01)


@pytest.mark.parametrize("pixels", [4.0, -8.0])
def test_the_skew_is_speed_times_readout(renderer, pixels):
    readout_s = 0.005
    light = integrate(renderer, turning(pixels / CAMERA.fx / readout_s), still, 0.0, readout_s)
    rows = np.arange(24, 72)
    slope = np.polyfit(rows, edges(renderer, light, rows), 1)[0]
    # The camera turns to the right, so the edge moves to the left.
    assert slope * SIZE == pytest.approx(-pixels, rel=0.05)
    assert edges(renderer, light, np.array([47, 48])).mean() == pytest.approx(CAMERA.cx, abs=0.15)


def test_what_moves_is_blurred_in_front_of_what_stays():
    cube = Body(9, (Part("cube", box((-0.2, 0, -0.2), (0.2, 0.1, 0.2)), WHITE, 0.3),), np.eye(4), "thing")
    moved = half_white([cube])
    speed, exposure_s = 20.0, 0.01

    def bodies(time):
        return {1: make_pose(np.eye(3), np.array([1.0, 0, speed * time]))}

    blurred = image(moved, integrate(moved, turning(0.0), bodies, exposure_s, 0.0))
    sharp = image(moved, moved.radiance(turning(0.0)(np.zeros(1))[0], bodies(0.0)))
    column = int(CAMERA.cx + CAMERA.fx * 1.0 / 1.9)
    rows = [np.flatnonzero(picture[:, column] > 0.02) for picture in (sharp, blurred)]
    grown = (rows[1].max() - rows[1].min()) - (rows[0].max() - rows[0].min())
    assert grown == pytest.approx(CAMERA.fx * speed * exposure_s / 1.9 * (1 - 1 / MOST), abs=1.5)
    assert np.allclose(blurred[:, :40], sharp[:, :40], atol=1e-5)
