"""Where a thing was, by what was carried."""

import contextlib
import re
import shutil

import numpy as np
import pytest
import torch

from egosplat import cli
from egosplat.query.histories import Histories
from egosplat.query.history import Carried, clock, place_at
from egosplat.query.opening import open_scene
from egosplat.query.text import Texts
from tests.support.page_scene import PUT_DOWN, TAKEN_UP, put_page_scene
from tests.support.scenes import put

TABLE, DESK, SHELF = np.eye(3)
# Axes of features: a cup, a box, a hand, and any object.
CUP, BOX, HAND, OBJECT = torch.eye(4)


def carried(from_s, until_s, start, end):
    return Carried(0.9, from_s, until_s, start, end, 0.1, 0, (0, 0, 1, 1))


HISTORY = (carried(4.2, 7.0, TABLE, DESK), carried(16.0, 18.5, DESK, SHELF))


@pytest.mark.parametrize(
    ("second", "position", "told"),
    [
        (0, TABLE, "until 0:04"),
        (4.2, None, "carried since 0:04, until 0:07"),
        (5, None, "carried since 0:04, until 0:07"),
        (10, DESK, "since 0:07, until 0:16"),
        (17, None, "carried since 0:16, until 0:18"),
        (18.6, SHELF, "since 0:18"),
        (1e6, SHELF, "since 0:18"),
        (-5, TABLE, "until 0:04"),
    ],
)
def test_a_thing_was_where_it_was_put_last(second, position, told):
    place = place_at(HISTORY, second)
    assert place.told == told
    assert (place.position is None) == (position is None)
    if position is not None:
        np.testing.assert_array_equal(place.position, position)


def test_between_carries_that_do_not_meet_the_place_is_not_known():
    """The thing was put on the desk, and taken from the table."""
    apart = (HISTORY[0], carried(16.0, 18.5, TABLE, SHELF))
    assert (
        place_at(apart, 10).position is None
        and place_at(apart, 10).told == "not known since 0:07, until 0:16"
    )
    np.testing.assert_array_equal(place_at(apart, 20).position, SHELF)


def test_a_start_that_nobody_saw_is_not_told():
    """It may be where the carry before has left it."""
    unseen = carried(16.0, 18.5, np.full(3, np.nan), SHELF)
    assert place_at((unseen,), 10).position is None and place_at((unseen,), 10).told == "not known until 0:16"
    np.testing.assert_array_equal(place_at((HISTORY[0], unseen), 10).position, DESK)


def test_two_carries_tell_the_place_between_them():
    """Each tells it to a few centimeters. A thing that was lost lies where it is taken up next, or nobody knows where."""
    near = carried(16.0, 18.5, DESK + [0.1, 0, 0], SHELF)
    np.testing.assert_allclose(place_at((HISTORY[0], near), 10).position, DESK + [0.05, 0, 0])
    lost = carried(4.2, 7.0, TABLE, np.full(3, np.nan))
    np.testing.assert_array_equal(place_at((lost, HISTORY[1]), 10).position, DESK)
    assert place_at((lost,), 10).position is None and place_at((lost,), 10).told == "not known since 0:07"


def test_what_was_not_carried_has_no_place_in_time():
    assert place_at((), 3.0) is None


def test_clock():
    assert [clock(second) for second in (0, 9.99, 65, 3600)] == ["0:00", "0:09", "1:05", "60:00"]


class Carries:
    """carries.zarr with these features, in turn at 0, 10, 20 ... s for five seconds each, or at once."""

    def __init__(self, features, step=10):
        count = len(features)
        first = step * np.arange(count)
        self.arrays = {
            "first_frame": first,
            "last_frame": first + 5,
            "start": np.zeros((count, 3)),
            "end": np.ones((count, 3)),
            "size": np.full(count, 0.1),
            "best_frame": first,
            "box": np.zeros((count, 4), np.int32),
            "feature": np.array(features, np.float32).reshape(count, 4),
        }

    def read(self, name):
        return self.arrays[name]


def history(features, step=10):
    """Seconds at which what "cup" means was taken up."""
    return told(Carries(features, step))


def told(carries, meaning=CUP):
    """The same of carries.zarr, for any meaning."""
    made = Histories(carries, np.arange(100.0))
    words = Texts(("cup", "box", "hand"), torch.stack([CUP, BOX, HAND]), OBJECT[None])
    query = Texts(("it",), meaning[None], OBJECT[None])
    return [one.from_s for one in made.of(query, words, 10.0)]


def mixed(*parts):
    total = sum(share * axis for share, axis in parts)
    return (total / total.norm()).tolist()


def test_only_what_looks_most_like_the_query_is_its_history():
    cup, box = CUP.tolist(), mixed((0.4, CUP), (0.6, BOX))
    assert history([cup, box, mixed((0.6, CUP), (0.4, HAND))]) == [0.0, 20.0]
    assert history([mixed((0.4, CUP), (0.6, OBJECT))]) == [], "like any object"


def test_only_names_of_what_people_carry_compete():
    """The masks of a cup show more of the hand that holds it; nobody carries a hand about."""
    assert history([mixed((0.4, CUP), (0.6, HAND))]) == [0.0]
    assert told(Carries([HAND.tolist()]), HAND) == []


def test_of_carries_at_one_time_the_longest_stays():
    made = Carries([mixed((0.8, CUP), (0.2, BOX)), CUP.tolist()], step=1)
    made.arrays["last_frame"] = np.array([9, 4])
    assert told(made) == [0.0]


def test_a_carry_without_its_name_joins_two_that_do_not_meet():
    """The middle carry looks like a hand; it begins where the first one ends, and ends where the last one begins."""
    made = Carries([CUP.tolist(), HAND.tolist(), CUP.tolist(), HAND.tolist()])
    made.arrays["start"] = np.array([TABLE, DESK, SHELF, DESK])
    made.arrays["end"] = np.array([DESK, SHELF, TABLE, SHELF])
    assert told(made) == [0.0, 10.0, 20.0]
    made.arrays["start"][1] = TABLE
    assert told(made) == [0.0, 20.0], "it does not begin there"


def test_no_carry_and_no_view_have_no_history():
    assert history([]) == []
    assert history([[0.0] * 4]) == []


def test_a_scene_tells_the_history_of_an_answer(tmp_path, monkeypatch, capfd):
    """The cup of the small scene: in the library, in the table, and at a time."""
    put_page_scene(tmp_path)
    scene = open_scene(tmp_path, min_score=0.7)
    cup, couch = scene.ask("cup", "couch")
    [carried] = cup.history
    np.testing.assert_array_equal([carried.start, carried.end], [TAKEN_UP, PUT_DOWN])
    assert (carried.from_s, carried.until_s, carried.box) == (
        pytest.approx(0.1),
        pytest.approx(0.2),
        (10, 20, 30, 40),
    )
    assert carried.score > 0.5 and couch.history == () and couch.at(0.0) is None

    def table(*words):
        monkeypatch.setattr(
            "sys.argv", ["egosplat", "query", str(tmp_path), "cup", "couch", *words, "--overwrite"]
        )
        with contextlib.suppress(SystemExit):
            cli.main()
        said = capfd.readouterr()
        return said.out.split("\n\n")[1].splitlines()[:-1] if "\n\n" in said.out else said.err

    assert [re.split(r"\s{2,}", line) for line in table()] == [
        ["carried thing", "carried [min:s]", "from [m]", "to [m]", "frame"],
        ["cup", "0:00 to 0:00", "-1.00, 0.00, 2.00", "1.00, 0.00, 2.00", "2"],
    ]
    assert re.split(r"\s{2,}", table("--at", "0:0.3")[1]) == ["cup", "1.00, 0.00, 2.00", "since 0:00"]
    assert "give seconds, as 65" in table("--at", "soon")
    assert "give seconds, as 65" in table("--at", "-1")
    assert "the recording ends at 0:00" in table("--at", "0:01")
    assert "a view, such as frame 1, has no history" in table("--at", "0", "--frame", "1")


def test_carries_of_other_gaussians_tell_nothing(tmp_path):
    """Protects answers after the Gaussians were trained again: places of before may be wrong."""
    put_page_scene(tmp_path)
    shutil.rmtree(tmp_path / "carries.zarr")
    put(tmp_path, "carries", {"feature": np.zeros((1, 4), np.float32)}, inputs={"splats.zarr": "0" * 64})
    scene = open_scene(tmp_path)
    assert scene.histories is None and scene.ask("cup")[0].history == ()
