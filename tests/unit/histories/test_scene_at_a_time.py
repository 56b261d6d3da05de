"""A scene at a time: what lies somewhere for a while."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.query.command import run
from egosplat.query.finished_scene import open_scene
from egosplat.query.scene import QueryScene, Viewpoint
from egosplat.query.text import Texts
from egosplat.query.views import Asker
from tests.support.gaussian_scene import SETTINGS
from tests.support.langsplat import LANGSPLAT
from tests.support.page_scene import put_histories
from tests.support.sightings import make_rests
from tests.support.splats import blobs

CAMERA, EYE = Camera(64, 48, 60.0, 60.0, 32.0, 24.0), np.eye(4)
TEXTS = Texts(("wall", "cup"), torch.eye(4)[:2], torch.eye(4)[2:3])
OPTIONS = LANGSPLAT.change(box_filter=0.0)


def balls(*places):
    """Opaque balls of 10 cm."""
    return replace(blobs(list(places), [0.98] * len(places), 0.1), sh=torch.ones(len(places), 1, 3))


@pytest.fixture
def scene() -> QueryScene:
    """A ball on the left that is the wall, at both levels."""
    codes = torch.eye(4)[:1, None].repeat(1, 2, 1), torch.ones(1, 2), Decoder((4,), np.zeros(0, np.float32))
    return QueryScene(balls((-0.5, 0, 2)), SETTINGS, CAMERA, 0, *codes, ["part", "whole"])


def rests_of(*spans):
    """A rest of the cup for each span [s], a ball on the right each, and a thing that nobody sees."""
    count, span = len(spans), np.array(spans, np.float64).reshape(-1, 2)
    gaussians = balls(*((0.3 + 0.1 * number, 0, 2) for number in range(count)))
    things, owner = torch.cat([torch.eye(4)[1:2], torch.zeros(1, 4)]), np.zeros(count, np.int64)
    return make_rests(owner, *span.T, things, gaussians=gaussians, rest=np.arange(count))


def test_a_rest_holds_from_its_first_to_its_last_frame():
    one_after_the_other, one_of_a_frame = rests_of((1, 2), (2, 3)), rests_of((0, 9), (4, 4))
    for second, there in ((0.5, []), (1, [0]), (2, [0, 1]), (3.1, [])):
        assert one_after_the_other.at(second).tolist() == there
    for second, there in ((4, [0, 1]), (np.nextafter(4, 5), [0])):
        assert one_of_a_frame.at(second).tolist() == there
    assert rests_of().at(1).tolist() == []


def answers(scene, rests, second=1.0, **keys):
    at = Viewpoint("", EYE, None, second)
    return list(Asker(scene, TEXTS, OPTIONS.change(**keys), rests).ask(TEXTS.phrases, CAMERA, at))


def test_what_lies_there_answers_at_its_time_and_hides_what_is_behind(scene):
    rests = rests_of((1, 2))
    wall, cup = answers(scene, rests)
    assert cup.score > 0.99 and cup.pixel[0] > 36 and cup.mask.any() and not cup.mask[:, :30].any()
    assert cup.position[2] == pytest.approx(2.0, abs=0.01)
    assert wall.score > 0.99 and wall.pixel[0] < 30
    rests.gaussians.means[:] = torch.tensor([-0.25, 0, 1])
    wall, cup = answers(scene, rests)
    assert wall.score < 0.6 and cup.mask[24, 17] and cup.position[2] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    "readout, rests, second",
    [
        ("gaussians", rests_of((1, 2)), 3.0),
        ("gaussians", rests_of((1, 2)), None),
        ("gaussians", rests_of(), 1.0),
        # A thing's feature is no code of theirs.
        ("pixels", rests_of((1, 2)), 1.5),
    ],
)
def test_without_a_rest_at_a_time_answers_are_those_without_time(scene, readout, rests, second):
    """To the bit: a scene's scores must not change where nothing rests."""
    pairs = (answers(scene, *at, readout=readout) for at in ((None, None), (rests, second)))
    for one, other in zip(*pairs, strict=True):
        assert (one.score, one.pixel, one.level) == (other.score, other.pixel, other.level)
        np.testing.assert_array_equal(one.relevancy, other.relevancy)
        np.testing.assert_array_equal(one.mask, other.mask)


def test_a_thing_without_a_feature_has_no_relevancy(scene):
    rests = rests_of((1, 2))
    rests.thing[:] = 1
    wall, cup = answers(scene, rests)
    assert wall.score > 0.99 and cup.score < 0.6 and not wall.mask[:, 36:].any()


def test_colors_are_those_of_the_time(scene):
    rests = rests_of((1, 2))
    assert scene.at(rests, 3.0) is scene.at(rests, None) is scene.at(None, 1.0) is scene
    assert scene.at(rests, 1.0).picture(CAMERA, EYE)[24, 41].min() > 0.5
    assert not scene.picture(CAMERA, EYE)[24, 41].any()


def test_a_frame_or_a_pose_at_a_time_shows_what_lies_there(tmp_path, page_scene):
    """Red where the cup is taken up, in the frames until then; a pose has no time."""
    folder = shutil.copytree(page_scene, tmp_path / "scene")
    plain = open_scene(folder).render(0)
    put_histories(folder, ((0, 1), (4, 4)))
    scene = open_scene(folder)
    for frame, shown in ((0, True), (1, True), (2, False), (4, True)):
        red = scene.render(frame)[..., 0] - scene.render(pose=scene.poses[frame])[..., 0]
        assert (red.max() > 0.2) == shown
    np.testing.assert_array_equal(scene.render(pose=scene.poses[0]), plain)
    framed, posed = scene.viewpoint(2), scene.viewpoint(pose=scene.poses[2])
    assert framed.second == pytest.approx(0.2) and posed.second is None
    np.testing.assert_array_equal(scene.render(pose=scene.poses[0], second=0.1), scene.render(0))
    for given in ({"frame": 0}, {}):
        with pytest.raises(UserError, match="second"):
            scene.ask("cup", second=0.1, **given)
    assert scene.rests.gaussians.count == 8
    assert scene.rests.from_s.tolist() == scene.seconds[[0, 4]].tolist()
    # The command's picture shows what rests, and its title tells the time.
    view, pictures = scene.viewpoint(pose=scene.poses[0]), set()
    for at in (0.1, 0.3, None):
        told = "".join(run(scene, ["cup"], view, 1, tmp_path / "query.png", at))
        assert ("a pose at 0:00, origin" in told) == (at is not None)
        pictures.add((tmp_path / "query.png").read_bytes())
    assert len(pictures) == 3
