"""What the viewer draws: heat, instances, what fits alone, depth, and photographs with what moves."""

import numpy as np
import pytest

from egosplat.query.options import LANGSPLAT
from egosplat.viewer.pictures import NOTHING, Painted, browser_camera, draw, heat, instances
from egosplat.viewer.questions import open_questions
from egosplat.viewer.recording import MOVING, photograph
from egosplat.viewer.scene import open_scene
from egosplat.viewer.world import World
from tests.support.scenes import put


@pytest.fixture
def world(word_scene) -> World:
    """The couch on the left and the cup on the right."""
    made = World(open_scene(word_scene(), "cpu"))
    made.load_questions(
        lambda viewed: open_questions(viewed, LANGSPLAT, device="cpu", precision="auto", cache=None)
    )
    return made


def drawn(world: World, painted: Painted, side: int = 48) -> tuple[np.ndarray, np.ndarray]:
    camera = browser_camera(1.0, side, side)
    return draw(world.viewed.trained, painted, camera, world.viewed.camera_to_world[0])


def test_the_cups_half_is_hot(world):
    """Heat of a query lies on the Gaussians that fit; the others are grey and dim."""
    reply = world.questions.ask("cup")
    painted = world.plain.colored(heat(world.plain.colors, reply.fit[reply.level], 0.5))
    plain, hot = drawn(world, world.plain)[0].astype(int), drawn(world, painted)[0].astype(int)
    assert np.ptp(hot[16:32, 30:44], axis=-1).min() > 60
    assert np.ptp(hot[16:32, 4:12], axis=-1).max() < 3
    assert hot[16:32, 4:12].mean() < 0.7 * plain[16:32, 4:12].mean()


def test_only_what_fits_leaves_the_rest_empty(world):
    """Pixels of Gaussians that are left out are black and have no depth."""
    reply = world.questions.ask("cup")
    image, depth = drawn(world, world.plain.only(reply.fit[reply.level] >= 0.5))
    assert image[16:32, 4:12].max() < 3 and (depth[16:32, 4:12] == NOTHING).all()
    assert depth[16:32, 32:44] == pytest.approx(2.0, abs=0.05)


def test_nothing_to_draw_is_an_empty_picture(world):
    """A threshold above every relevancy draws nothing, and does not fail."""
    image, depth = drawn(world, world.plain.only(np.zeros(world.plain.gaussians.count, bool)))
    assert image.max() < 3 and (depth == NOTHING).all()


def test_heat_begins_at_the_threshold():
    """Below it a Gaussian is dim and grey; the best ones are red, and no threshold fails."""
    own, fit = np.full((4, 3), 0.5, np.float32), np.array([0.2, 0.5, 0.7, 0.9], np.float32)
    colors = heat(own, fit, 0.5)
    assert np.ptp(colors[0]) == 0 and colors[0, 0] < 0.35
    assert colors[1].argmax() == 2 and colors[3].argmax() == 0
    assert (
        np.isfinite(heat(own, fit, 0.95)).all() and np.isfinite(heat(own, np.ones(4, np.float32), 0.99)).all()
    )


def test_an_instance_has_one_color():
    """Gaussians of an instance get its color; those of none are grey."""
    palette = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    colors = instances(np.full((4, 3), 0.5, np.float32), np.array([0, 1, 1, -1]), palette)
    assert colors[0].argmax() == 0 and colors[1].argmax() == 1
    assert np.array_equal(colors[1], colors[2]) and np.ptp(colors[3]) == 0


def test_instances_come_from_the_nearest_gaussian(word_scene):
    """instances.zarr has Gaussians of its own; each Gaussian of the scene takes the instance of the nearest one."""
    folder = word_scene()
    arrays = {
        "gaussians/xyz": np.array([[-0.8, 0.0, 2.0], [0.8, 0.0, 2.0]], np.float32),
        "gaussians/instance": np.array([[-1, 4], [-1, 5]], np.int32),
        "instances/level": np.zeros(6, np.int8),
        "labels": np.zeros((4, 2, 48, 48), np.int32),
    }
    put(folder, "instances", arrays, {"levels": ["part", "whole"]}, made_from=["frames"])
    world = World(open_scene(folder, "cpu"))
    right = world.plain.gaussians.means[:, 0].numpy() > 0
    assert world.instance_levels == ("part", "whole")
    assert np.array_equal(world.owners(1), np.where(right, 5, 4)) and (world.owners(0) == -1).all()
    assert world.instances_at(np.array([0.5, 0.1, 2.0])) == {"whole": 5}


def test_a_scene_without_instances_or_masks_opens(world):
    """A still scene has no masks; there is nothing to tint then."""
    assert world.instance_levels == () and world.instances_at(np.zeros(3)) == {}
    assert np.array_equal(photograph(world.viewed, 0, True), photograph(world.viewed, 0, False))


def test_what_moves_is_tinted(word_scene):
    """Masked pixels of a photograph take the color of what moves; the others are as photographed."""
    folder = word_scene()
    refined = np.zeros((4, 48, 48), bool)
    refined[1, :, :24] = True
    put(folder, "masks", {"refined": refined}, {}, made_from=["frames"])
    viewed = open_scene(folder, "cpu")
    plain, tinted = photograph(viewed, 1, False).astype(int), photograph(viewed, 1, True).astype(int)
    assert np.array_equal(plain[:, 24:], tinted[:, 24:])
    assert np.abs(tinted[:, :24] - MOVING).mean() < 0.5 * np.abs(plain[:, :24] - MOVING).mean()


def test_the_first_view_is_a_frame_with_a_pose(world):
    """Frame 3 has none. What is ahead of frame 0 is the wall, unless the reach of the scene is shorter."""
    assert world.first_frame in (0, 1, 2)
    ahead = world.depth_ahead(world.viewed.camera_to_world[0])
    assert ahead == pytest.approx(min(2.0, world.viewed.reach), abs=0.02)
