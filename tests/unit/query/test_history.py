"""Where a thing was, by what was carried."""

import contextlib
import re
import shutil

import click
import numpy as np
import pytest
import torch

from egosplat import cli
from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.reader import open_artifact
from egosplat.cli.flags import Time
from egosplat.errors import UserError
from egosplat.query.histories import Histories, ThingHistories
from egosplat.query.history import Carried, clock, meet, place_at
from egosplat.query.opening import open_scene
from egosplat.query.text import Texts
from tests.support.page_scene import PUT_DOWN, TAKEN_UP, put_page_scene, put_rests
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
    assert "frame 1 has its own time" in table("--at", "0", "--frame", "1")
    assert "--at 99:00: the recording ends at 0:00" in table("--at", "99:00")
    assert "since 0:00" in table("--at", "0:0.9")[1], "it is shown as 0:00, as the end is"
    assert "give seconds, as 65" in table("--at", "nan")


def test_carries_of_other_gaussians_tell_nothing(tmp_path):
    """Protects answers after the Gaussians were trained again: places of before may be wrong."""
    put_page_scene(tmp_path)
    shutil.rmtree(tmp_path / "carries.zarr")
    put(tmp_path, "carries", {"feature": np.zeros((1, 4), np.float32)}, inputs={"splats.zarr": "0" * 64})
    scene = open_scene(tmp_path)
    assert scene.histories is None and scene.ask("cup")[0].history == ()


class RestsOf(Carries):
    """rests.zarr: (thing, first frame, last frame, place) of each rest, (thing, rest before, rest after) of each carry."""

    def __init__(self, rests, carries, features):
        things, first, last, place = zip(*rests, strict=True) if rests else ((),) * 4
        of, before, after = np.array(carries, np.int32).reshape(-1, 3).T
        self.arrays = {
            "thing": np.array(things, np.int32),
            "from_frame": np.array(first, np.int64),
            "until_frame": np.array(last, np.int64),
            "best_frame": np.array(first, np.int64),
            "box": np.zeros((len(rests), 4), np.int32),
            "size": np.full(len(rests), 0.2),
            "absent_before": np.full(len(rests), -1),
            "absent_after": np.full(len(rests), -1),
            "center": np.array(place, np.float64).reshape(-1, 3),
            "carries/thing": of,
            "carries/from_rest": before,
            "carries/to_rest": after,
            "things/feature": np.array(features, np.float32).reshape(-1, 4),
        }


def history_of_things(carries, rests, query=CUP):
    made = ThingHistories(carries, rests, np.arange(100.0))
    words = Texts(("cup", "box", "hand"), torch.stack([CUP, BOX, HAND]), OBJECT[None])
    return made.of(Texts(("cup",), query[None], OBJECT[None]), words, 10.0)


def test_a_thing_with_rests_is_told_from_rest_to_rest():
    """The carries look like hands; their thing is a cup. Times and places are those of its rests."""
    carries = Carries([HAND.tolist()] * 3)
    rests = RestsOf(
        [(0, 0, 1, TABLE), (0, 6, 9, DESK), (0, 17, 30, SHELF)],
        [(0, 0, 1), (0, 1, 2), (-1, -1, -1)],
        [CUP.tolist()],
    )
    told = history_of_things(carries, rests)
    assert [(one.from_s, one.until_s) for one in told] == [(1, 6), (9, 17)]
    assert [place_at(told, second).carried for second in (1, 3, 7, 9, 20)] == [True, True, False, True, False]
    for second, position in ((0, TABLE), (7, DESK), (18, SHELF), (50, SHELF)):
        np.testing.assert_array_equal(place_at(told, second).position, position)


def test_a_place_that_is_seen_empty_is_not_told():
    """It lay on the table from second 6 to 9: seconds 3 and 14 show the table without it, and no carry is known."""
    rests = RestsOf([(0, 6, 9, TABLE)], [(-1, -1, -1)], [CUP.tolist()])
    rests.arrays |= {"absent_before": np.array([3]), "absent_after": np.array([14])}
    told = history_of_things(Carries([CUP.tolist()]), rests)
    assert [(one.from_s, one.until_s) for one in told] == [(3, 6), (9, 14)]
    places = [place_at(told, second).position for second in (1, 5, 7, 12, 20)]
    assert [place is not None for place in places] == [False, False, True, False, False]
    assert place_at(told, 5).told == "not known since 0:03, until 0:06", "a hand may only have hidden it"


def test_a_track_alone_confirms_no_place():
    """The track ends at the desk, and no frame shows the thing at rest there."""
    rests = RestsOf([(0, 0, 4, TABLE)], [(0, 0, -1)], [CUP.tolist()])
    [one] = history_of_things(Carries([CUP.tolist()]), rests)
    assert one.start_is_known and not one.end_is_known


def test_a_history_is_of_the_thing_that_fits_best():
    """Two cups are two things; a carry of no thing that rests is told by nobody, nor one that would join two."""
    better, worse = mixed((0.9, CUP), (0.1, HAND)), mixed((0.7, CUP), (0.3, HAND))
    carries = Carries([CUP.tolist()] * 4)
    rests = RestsOf(
        [(0, 6, 9, TABLE), (1, 16, 19, DESK)],
        [(0, -1, 0), (1, -1, 1), (-1, -1, -1), (0, 0, -1)],
        [worse, better],
    )
    assert [one.until_s for one in history_of_things(carries, rests)] == [16]
    rests.arrays["things/feature"][1] = 0
    told = history_of_things(carries, rests)
    assert [(one.from_s, one.until_s) for one in told] == [(0, 6), (9, 35)]
    assert place_at(told, 7).position.tolist() == TABLE.tolist()


def test_a_carry_whose_rests_overlap_lasts_between_these_times():
    """Frames may show a thing at its new place before it has left all frames of the old one."""
    rests = RestsOf([(0, 0, 4, TABLE), (0, 3, 9, DESK)], [(0, 0, 1)], [CUP.tolist()])
    [one] = history_of_things(Carries([CUP.tolist()]), rests)
    assert (one.from_s, one.until_s) == (3, 4)


@pytest.mark.parametrize("features", [[], [CUP.tolist()]])
def test_no_rest_has_no_history(features):
    rests = RestsOf([], [(-1, -1, -1)] * len(features), [])
    assert history_of_things(Carries(features), rests) == ()


def test_a_scene_with_rests_tells_of_its_things(tmp_path):
    put_page_scene(tmp_path)
    put_rests(tmp_path, ((0, 1), (4, 4)))
    cup, couch = open_scene(tmp_path, min_score=0.7).ask("cup", "couch")
    [carried] = cup.history
    assert (carried.from_s, carried.until_s) == (pytest.approx(0.1), pytest.approx(0.4))
    np.testing.assert_array_equal([carried.start, carried.end], [TAKEN_UP, PUT_DOWN])
    assert couch.history == () and carried.box == (10, 20, 30, 40)


def test_rests_of_other_carries_tell_nothing(tmp_path):
    """Numbers of carries would be those of others."""
    put_page_scene(tmp_path)
    put_rests(tmp_path, ((0, 1), (4, 4)))
    arrays = {"feature": np.zeros((1, 128), np.float32)}
    shutil.rmtree(tmp_path / "carries.zarr")
    put(tmp_path, "carries", arrays, made_from=["frames", "poses", "instances", "splats"])
    assert type(open_scene(tmp_path).histories) is Histories


def test_a_time_that_is_none_is_an_error():
    """NaN compares as neither before nor after: it would tell that the thing was not carried."""
    with pytest.raises(UserError, match="nan is no time"):
        place_at(HISTORY, float("nan"))
    np.testing.assert_array_equal(place_at(HISTORY, float("inf")).position, SHELF)


def test_of_two_equal_things_that_change_places_one_is_told():
    """Carries are named by words alone: at one time, one of them is the history."""
    made = Carries([CUP.tolist()] * 2, step=0)
    made.arrays["start"], made.arrays["end"] = np.array([TABLE, DESK]), np.array([DESK, TABLE])
    assert told(made) == [0.0]


@pytest.mark.parametrize("seconds", [np.zeros(100), np.arange(100.0)[::-1]], ids=["one time", "backwards"])
def test_times_that_do_not_rise_tell_finite_places(seconds):
    """Readers of recordings refuse such times; a file that was edited may hold them."""
    made = Histories(Carries([CUP.tolist()] * 3), seconds)
    words = Texts(("cup", "box"), torch.stack([CUP, BOX]), OBJECT[None])
    found = made.of(Texts(("cup",), CUP[None], OBJECT[None]), words, 10.0)
    assert found
    for second in (-1.0, 0.0, 50.0, 99.0):
        place = place_at(found, second)
        assert place.position is None or np.isfinite(place.position).all()


def test_the_start_of_a_thing_with_a_size_of_zero():
    """A size of 0 lets two places meet only if they are one."""
    nothing = Carried(0.9, 0.0, 1.0, TABLE, DESK, 0.0, 0, (0, 0, 1, 1))
    assert meet(nothing, DESK, DESK) and not meet(nothing, DESK, TABLE)


EDITED = [
    ({"last_frame": [2, 99]}, "'last_frame' tells of frame 99, and the recording has 5"),
    ({"first_frame": [5, 1]}, "'first_frame' tells of frame 5"),
    ({"best_frame": [2, 2**40]}, "'best_frame' tells of frame 1099511627776"),
    ({"first_frame": [3, 2], "last_frame": [2, 3]}, "1 of 2 carries end before they begin"),
]


@pytest.mark.parametrize(("changes", "said"), EDITED, ids=["after the end", "start", "best", "backwards"])
def test_carries_outside_of_the_recording_are_damaged(tmp_path, changes, said):
    """The message names the file, what is wrong, and the command that makes it anew."""
    folder = tmp_path / "results/adt/scene1"
    folder.mkdir(parents=True)
    put_page_scene(folder)
    edited = {key: np.array(values) for key, values in changes.items()}
    put_carries(folder, edited)
    with pytest.raises(UserError) as caught:
        open_scene(folder).ask("cup")
    message = str(caught.value)
    assert message.startswith(f"{folder / 'carries.zarr'}: {said}")
    assert f"Rebuild it: rm -r {folder / 'carries.zarr'} && snakemake" in message


def put_carries(folder, arrays, made_from=("splats",)):
    """Write carries.zarr anew, with features as wide as those of the scene."""
    carries = open_artifact(folder / "carries.zarr", CARRIES)
    before = {name: carries.read(name) for name in CARRIES.fields}
    shutil.rmtree(folder / "carries.zarr")
    put(folder, "carries", before | arrays, made_from=made_from)


def test_without_a_carry_no_time_tells_a_place(tmp_path, monkeypatch, capfd):
    """Nothing was carried: a time within the recording says so, in the library and in the table."""
    put_page_scene(tmp_path)
    carries = open_artifact(tmp_path / "carries.zarr", CARRIES)
    put_carries(tmp_path, {name: carries.read(name)[:0] for name in CARRIES.fields})
    scene = open_scene(tmp_path)
    [cup] = scene.ask("cup")
    assert scene.histories.every == () and cup.history == () and cup.at(0.1) is None
    monkeypatch.setattr("sys.argv", ["egosplat", "query", str(tmp_path), "cup", "--at", "0", "--overwrite"])
    with contextlib.suppress(SystemExit):
        cli.main()
    assert "nothing of this was carried, as far as is known" in capfd.readouterr().out


def test_carries_with_features_of_another_openclip_tell_nothing(tmp_path):
    """Their features compare with no word: a channel more or less was an error of torch."""
    put_page_scene(tmp_path)
    put_carries(tmp_path, {"feature": np.ones((2, 3), np.float32) / np.sqrt(3, dtype=np.float32)})
    scene = open_scene(tmp_path)
    assert scene.histories is None and scene.ask("cup")[0].history == ()


@pytest.mark.parametrize(
    ("given", "second"),
    [("65", 65.0), ("1:05", 65.0), ("0:0.5", 0.5), ("61:00", 3660.0), ("1:90", 150.0)]
    + [
        (bad, None)
        for bad in ("nan", "1:nan", "inf", "-1", "1:-5", "-1:90", "1:2:3", "", ":", "9" * 400 + ":0")
    ],
)
def test_times_on_the_command_line(given, second):
    """A sign in either part, and what is no number, is an error that shows how a time is given."""
    if second is not None:
        assert Time().convert(given, None, None) == second
        return
    with pytest.raises(click.BadParameter, match="give seconds, as 65"):
        Time().convert(given, None, None)
