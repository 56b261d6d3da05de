"""What moves has no place: a query tells when it was seen."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.export.gaussians import answer_members
from egosplat.geometry import Camera
from egosplat.pipeline.validation import schema
from egosplat.query import grades, moving
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import by_score
from egosplat.query.moving import Tracks
from egosplat.query.options import QueryOptions
from egosplat.query.text import Texts
from egosplat.viewing.command import open_page
from egosplat.viewing.options import PageOptions
from tests.support.page_scene import put_page_scene
from tests.unit.histories.test_history import mixed

CUP, BOX, BED, OBJECT = torch.eye(4)
SECONDS = np.arange(60.0) / 5
# (track, frame, share) of each view: the first in frames 0 to 19 and 40 to 44, the second in frames 50 to 54.
VIEWS = [(0, frame, 0.1 + frame / 100) for frame in (*range(20), *range(40, 45))]
VIEWS += [(1, frame, 0.05) for frame in range(50, 55)]


def found(*features, query=CUP, phrase="it", views=VIEWS, least=0.5, worn=(), known=3):
    """What is told of tracks 10, 11 ... with features and views; ``worn`` ones are the wearer's."""
    track, frame, share = np.array(views).T
    numbers = np.arange(10, 10 + len(features))
    own = np.isin(numbers, worn)
    tracks = Tracks(numbers, torch.stack(features), own, track.astype(int), frame.astype(int), share)
    words = Texts(("cup", "box", "bed")[:known], torch.stack([CUP, BOX, BED])[:known], OBJECT[None])
    asked = Texts((phrase,), query[None], OBJECT[None])
    return tracks.find(asked, words, SECONDS, by_score(least), QueryOptions())


def test_tracks_that_fit_better_than_every_other_word_are_told_together():
    both = found(CUP, mixed(0.6, BOX))
    assert both.tracks.tolist() == [10, 11] and both.frame == 17 and both.rating > 0.9
    assert both.spans == ((0.0, 3.8), (8.0, 8.8), (10.0, 10.8))
    assert both.told == "0:00 to 0:03, 0:08 to 0:08, 0:10 to 0:10"
    alone = found(CUP, mixed(0.4, BOX))
    assert alone.tracks.tolist() == [10] and len(alone.spans) == 2


def test_what_is_not_certain_is_not_told():
    assert found(mixed(0.4, OBJECT), mixed(0.4, BOX)) is None, "any object and another word fit better"
    assert found(CUP, BOX, least=1.0) is None, "it is graded as things are"
    assert found(BOX, CUP) is None, "few views"
    assert found(BED, BED, query=BED) is None, "furniture stays"
    assert found(CUP, CUP, known=0) is None, "a model of another language knows no word of the list"
    assert found(CUP, BOX, worn=[10]) is None and found(CUP, BOX, query=BOX, views=VIEWS[:5]) is None


def test_the_wearer_is_told_for_words_of_people_whatever_the_arms_look_like():
    person = found(CUP, BOX, phrase="Person", query=BOX, worn=[10])
    assert person.tracks.tolist() == [10] and person.rating is None and len(person.spans) == 2
    assert found(CUP, BOX, phrase="Person", query=BOX) is None


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(moving, "_LEAST_VIEWS", 3)
    put_page_scene(tmp_path / "scene", arm=True)
    return tmp_path / "scene"


def test_every_answer_tells_when_a_person_was_seen(folder, monkeypatch, run_command):
    scene = open_scene(folder, device="cpu")
    person, cup = scene.ask("person", "cup")
    assert (person.grade, person.things, person.moving.frame) == ("seen moving", (), 4)
    assert person.moving.spans == (pytest.approx((0.1, 0.4)),) and cup.moving is None and cup.grade == "found"
    _, out, _ = run_command("query", folder, "person", "elephant", "--overwrite")
    told = next(line for line in out.splitlines() if line.startswith("person"))
    assert re.split(r"\s{2,}", told) == ["person", "seen moving", "-", "-", "0:00 to 0:00", "frame 4"]
    assert Image.open(folder / "query.png").size[1] > 400
    reply = open_page(folder, PageOptions(device="cpu"))[1](phrase="person")["answers"][0]
    assert reply["grade"] == "seen moving" and not reply["things"] and "seen moving" in str(schema("metrics"))
    assert reply["moving"] == {"rating": None, "frame": 4, "spans": [[*one] for one in person.moving.spans]}
    with pytest.raises(UserError, match="seen moving 0:00 to 0:00"):
        answer_members(scene, "person")
    view = scene.show("person", person.moving)
    assert view.mask[view.pixel[::-1]] and view.mask.sum() == 160 == (view.relevancy > 0)[view.mask].sum()
    monkeypatch.setattr(grades.Grading, "grade", lambda *_: "best guess")
    assert scene.ask("person")[0].grade == "seen moving", "what is certain is no guess"


def test_where_nothing_is_masked_a_person_is_not_found(page_scene, tmp_path):
    put_page_scene(tmp_path / "withheld", arm=True, masked=False)
    for folder, tracks in ((page_scene, None), (tmp_path / "withheld", 0)):
        scene = open_scene(folder, device="cpu")
        [person] = scene.ask("person")
        assert person.moving is None and person.grade == "not found"
        assert tracks == (scene.tracks and len(scene.tracks.number))


@pytest.mark.parametrize("turning", [True, False])
def test_what_has_one_direction_in_the_world_stands_still(turning):
    x = np.linspace(-0.4, 0.4, 20)
    poses = np.tile(np.eye(4), (20, 1, 1))
    if turning:
        poses[:, :3, :3] = Rotation.from_euler("y", -np.arctan(x)[:, None]).as_matrix()
    middle = 48 + 100 * x
    box = np.stack([middle - 4, np.full(20, 40), middle + 4, np.full(20, 48)], axis=1).astype(np.int32)
    views = {"instance": np.zeros(20, int), "frame": np.arange(20), "box": box, "area": np.full(20, 64)}
    arrays = {"instances/transient": np.ones(1, bool), "consistent": np.eye(4, dtype=np.float32)[:1]}
    artifacts = [SimpleNamespace(read=one.__getitem__) for one in (arrays, views, arrays)]
    tracks = Tracks.read(*artifacts, Camera(96, 96, 100.0, 100.0, 48.0, 48.0), poses, np.ones((96, 96), bool))
    assert len(tracks.number) == (not turning) and not tracks.worn.any()
