"""Images, labels and depth agree with independent computations from the scene."""

import numpy as np
import pytest

from egosplat.frames.rectify import Rectification, pinhole
from egosplat.geometry import ARIA_PIXEL_OFFSET, invert, make_pose, transform
from egosplat_apartments.adt_format.aria import camera_calibration
from egosplat_apartments.camera.lens import make_lens, pinhole_lens, tone, untone
from egosplat_apartments.camera.lighting import Lights
from egosplat_apartments.camera.raycasting import Body, body_scene, build_geometry
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.objects.atlas import Atlas
from egosplat_apartments.objects.shapes import Part, box, sheet
from egosplat_apartments.objects.textures import make_texture
from egosplat_apartments.world.world import camera_pose

SIZE = 192
GREY = make_texture(np.full((16, 16, 3), 0.5), 1.0)
LIGHTS = Lights(np.array([0, 3, 0], np.float32), np.array([0, 1, 0], np.float32), ())


@pytest.fixture(scope="module")
def rays():
    """(SIZE, SIZE, 3) with z = 1; NaN outside the lens circle."""
    pixels = np.mgrid[:SIZE, :SIZE].reshape(2, -1).T[:, ::-1].astype(float)
    found = [camera_calibration(SIZE).unproject(pixel) for pixel in pixels]
    return np.array([[np.nan] * 3 if ray is None else ray / ray[2] for ray in found]).reshape(SIZE, SIZE, 3)


def shoot(parts, height, size, poses=None, bodies=()):
    """What a camera at a height sees that looks down on parts and bodies."""
    camera = make_pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0, height, 0]))
    bodies = [*(Body(number, (part,), np.eye(4), "static") for number, part in enumerate(parts, 1)), *bodies]
    renderer = Renderer(build_geometry(bodies), LIGHTS, make_lens(size), np.random.default_rng(0))
    return renderer.shoot(camera, poses or {}, 1.0, np.random.default_rng(0))[1], camera


def test_rays_project_back_to_their_pixels():
    lens, calibration = make_lens(96), camera_calibration(96)
    rows, columns = np.nonzero(lens.valid)
    for number in range(0, len(rows), 97):
        pixel = calibration.project_no_checks(lens.directions[number].astype(np.float64)) + ARIA_PIXEL_OFFSET
        assert pixel == pytest.approx((columns[number] + 0.5, rows[number] + 0.5), abs=0.01)
    # The ray's change to the next pixel, and the angle that a pixel covers.
    inside = np.flatnonzero((lens.radius < 0.9) & (columns < 95))[:-1]
    step = lens.directions[inside + 1] - lens.directions[inside]
    same_row = rows[inside + 1] == rows[inside]
    assert np.allclose(step[same_row], lens.right[inside][same_row], atol=2e-3)
    middle = lens.radius < 0.1
    assert np.median(lens.angle[middle]) == pytest.approx(1 / calibration.get_focal_lengths()[0], rel=0.05)


def test_pinhole_rays_are_upright_and_end_at_the_lens_circle():
    camera = pinhole(64)
    lens = pinhole_lens(camera)
    rows, columns = np.nonzero(lens.valid)
    pixels = camera.project(lens.directions.astype(np.float64))
    assert pixels == pytest.approx(np.stack([columns, rows], axis=1) + 0.5, abs=1e-4)
    # The rectified image of the same side is valid at the same pixels, except at the rim of the circle.
    valid = Rectification(camera_calibration(64), camera, turns=1).valid
    assert (valid & ~lens.valid).sum() == 0 and (valid ^ lens.valid).mean() < 0.05


def test_ids_are_zero_exactly_outside_the_lens_circle(recorded, rays):
    outside = np.isnan(rays[..., 0])
    assert 0.05 < outside.mean() < 0.4
    for frame in recorded.frames[::8]:
        for view in (frame.with_people, frame.without_people):
            assert np.array_equal(view.segmentation == 0, outside)
            assert np.array_equal(view.depth_mm == 0, outside)
        assert (frame.rgb[outside] == 0).all()
        assert frame.rgb[~outside].mean() > 40


def test_depth_of_the_floor_equals_that_of_a_plane(recorded, rays):
    geometry = recorded.renderer.geometry
    floor = [n for n, name in enumerate(geometry.part_names) if name.endswith("/floor")]
    camera = camera_pose(recorded.world, 2.0)
    view = (camera, recorded.world.body_poses(2.0), 1.0)
    rgb, with_people, _ = recorded.renderer.shoot(*view, np.random.default_rng(0))
    picture, faces = recorded.renderer.picture(*view, np.random.default_rng(0))
    assert np.array_equal(picture, rgb)
    seen = np.isin(np.where(faces >= 0, geometry.face_part[faces], -1), floor)
    assert seen.sum() > 1000
    # The floor is y = 0: a ray z (x, y, 1) from height h meets it at z = -h / (its change in height).
    fall = rays[seen] @ camera[1, :3]
    expected = -camera[1, 3] / fall * 1000
    assert np.abs(with_people.depth_mm[seen] - expected).max() < 0.6


def test_moving_bodies_are_where_their_poses_are():
    ground = Part("ground", sheet((-5, 0, -5), (10, 0, 0), (0, 0, 10)), GREY)
    cube = Body(9, (Part("cube", box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2)), GREY),), np.eye(4), "thing")
    pose = make_pose(np.eye(3), np.array([0.6, 0.2, 0.3]))
    view, camera = shoot([ground], 2.0, 96, {1: pose}, [cube])
    rows, columns = np.nonzero(view.segmentation == 9)
    top = transform(invert(camera), np.array([0.6, 0.4, 0.3]))
    x, y = camera_calibration(96).project(top) + ARIA_PIXEL_OFFSET
    assert view.segmentation[int(y), int(x)] == 9
    assert view.depth_mm[int(y), int(x)] == pytest.approx(1600, abs=1)
    assert abs(columns.mean() + 0.5 - x) < 3 and abs(rows.mean() + 0.5 - y) < 3


def test_visibility_is_the_unoccluded_fraction():
    ground = Part("ground", sheet((-9, 0, -9), (18, 0, 0), (0, 0, 18)), GREY)
    board = Part("board", sheet((-0.4, 0.5, -0.4), (0.8, 0, 0), (0, 0, 0.8)), GREY)
    cover = Part("cover", sheet((0.0, 0.6, -0.6), (0.8, 0, 0), (0, 0, 1.2)), GREY)
    (view, _), (alone, _) = shoot([ground, board, cover], 2.5, 128), shoot([ground, board], 2.5, 128)
    expected = (view.segmentation == 2).sum() / (alone.segmentation == 2).sum()
    assert 0.4 < expected < 0.6
    assert view.visibility[2] == pytest.approx(expected, abs=0.03) and view.visibility[3] == 1.0


def test_shadows_fall_where_light_is_blocked():
    ground = Part("ground", sheet((-3, 0, -3), (6, 0, 0), (0, 0, 6)), GREY)
    roof = Part("roof", box((-0.3, 1.0, -0.3), (0.3, 1.05, 0.3)), GREY)
    bodies = [Body(n, (part,), np.eye(4), "static") for n, part in enumerate((ground, roof), start=1)]
    geometry = build_geometry(bodies)
    scene = body_scene(geometry, 0, 2)
    # Lamp at 3 m: the shadow of an edge at (0.3, 1.05) falls at 0.3 * 3 / 1.95 = 0.46 m.
    points = np.array([[0, 0, 0], [0.44, 0, 0], [0.49, 0, 0], [1.5, 0, 0]], np.float32)
    normals = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    light = LIGHTS.direct([scene], points, normals)[:, 0]
    assert (light[:2] == 0).all() and (light[2:] > 0).all()
    # Outside the shadow: cosine law and inverse square, bounded near the lamp.
    expected = [np.cos(np.arctan(x / 3)) / (0.5 + x**2 + 9) for x in (0.49, 1.5)]
    assert light[2] / light[3] == pytest.approx(expected[0] / expected[1], rel=0.01)
    assert (LIGHTS.direct([scene], points, -normals) == 0).all()


def test_sun_shines_through_windows_only():
    sun = np.array([0, 0.6, -0.8], np.float32)
    window = tuple(np.array(x, np.float32) for x in ([-0.5, 1, -2], [1, 0, 0], [0, 1, 0], [0, 0, 1]))
    dark = Lights(np.array([0, -50, 0], np.float32), sun, (window,))
    # On the way to the window plane z = -2, a ray from (x, 0, z) rises by 0.75 (z + 2).
    points = np.array([[0, 0, 0], [0, 0, -1], [0.6, 0, 0], [0, 0, 1.0]], np.float32)
    up = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    assert (dark.direct([], points, up)[:, 0] > 0).tolist() == [True, False, False, False]


def test_textures_show_their_mean_from_afar_and_texels_from_near():
    rng = np.random.default_rng(1)
    picture = make_texture(rng.uniform(0.3, 0.7, (64, 64, 3)), 0.64)
    atlas = Atlas([GREY, picture])
    number = np.ones(64, np.int32)
    centers = np.stack([(np.arange(64) + 0.5) * 0.01, np.full(64, 0.105)], axis=1).astype(np.float32)
    near = atlas.albedo(number, centers, np.full(64, 1e-3, np.float32))
    assert np.allclose(near, (picture.pixels[10] / 255.0) ** 2, atol=1e-5)
    far = atlas.albedo(number, centers, np.full(64, 5.0, np.float32))
    assert np.allclose(far, (picture.pixels.mean(axis=(0, 1)) / 255) ** 2, atol=0.01)
    assert np.allclose(far, atlas.mean_albedo[1], atol=0.01)
    wrapped = atlas.albedo(number, centers + np.float32(0.64), np.full(64, 1e-3, np.float32))
    assert np.allclose(wrapped, near, atol=1e-3)


def test_untone_inverts_tone():
    values = np.linspace(0, 30, 500, dtype=np.float32)
    assert np.allclose(untone(tone(values)), values, rtol=2e-3, atol=1e-4)
    assert (np.diff(tone(values)) > 0).all()
