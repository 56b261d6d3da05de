"""Where a thing was, by what was carried."""

import contextlib
import re
import shutil
from types import SimpleNamespace

import click
import numpy as np
import pytest
import torch

from egosplat.cli.flags import parse_time
from egosplat.errors import UserError
from egosplat.histories.known import Histories
from egosplat.histories.told import Carried, clock, place_at
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import find_history
from egosplat.query.text import Texts
from tests.support.page_scene import PUT_DOWN, TAKEN_UP, put_histories
from tests.support.scenes import put
from tests.support.sightings import make_rests

TABLE, DESK, SHELF = np.eye(3)
SECONDS, NO_LINK = np.arange(100.0), (-1, -1, -1)
# Axes of features: a cup, a box, a hand, and any object.
CUP, BOX, HAND, OBJECT = torch.eye(4)
NOTHING = torch.zeros(4)


def carried(from_s, until_s, start, end):
    return Carried(0.9, from_s, until_s, start, end, 0.1, 0, (0, 0, 1, 1))


NOWHERE = np.full(3, np.nan)
FIRST, SECOND = carried(4.2, 7.0, TABLE, DESK), carried(16.0, 18.5, DESK, SHELF)
UNSEEN, LOST = carried(16.0, 18.5, NOWHERE, SHELF), carried(4.2, 7.0, TABLE, NOWHERE)
FROM_TABLE, NEARBY = (carried(16.0, 18.5, start, SHELF) for start in (TABLE, DESK + [0.1, 0, 0]))
HISTORY = (FIRST, SECOND)


@pytest.mark.parametrize(
    ("history", "second", "position", "told"),
    [
        (HISTORY, 0, TABLE, "here until 0:04"),
        (HISTORY, 4.2, None, "carried from 0:04 to 0:07"),
        (HISTORY, 10, DESK, "here from 0:07 to 0:16"),
        (HISTORY, 17, None, "carried from 0:16 to 0:18"),
        (HISTORY, 18.6, SHELF, "here from 0:18 on"),
        (HISTORY, 1e6, SHELF, "here from 0:18 on"),
        (HISTORY, -5, TABLE, "here until 0:04"),
        # The thing was put on the desk, and taken from the table.
        ((FIRST, FROM_TABLE), 10, None, "place unknown from 0:07 to 0:16"),
        ((FIRST, FROM_TABLE), 20, SHELF, "here from 0:18 on"),
        # Nobody saw where it starts: it may be where the carry before has left it.
        ((UNSEEN,), 10, None, "place unknown until 0:16"),
        ((FIRST, UNSEEN), 10, DESK, "here from 0:07 to 0:16"),
        # Each of two carries tells the place between them to a few centimeters.
        ((FIRST, NEARBY), 10, DESK + [0.05, 0, 0], "here from 0:07 to 0:16"),
        # A thing that was lost lies where it is taken up next, or nobody knows where.
        ((LOST, SECOND), 10, DESK, "here from 0:07 to 0:16"),
        ((LOST,), 10, None, "place unknown from 0:07 on"),
    ],
)
def test_a_place_is_told_by_the_carries_before_and_after_it(history, second, position, told):
    place = place_at(history, second)
    assert place.told == told and (place.position is None) == (position is None)
    if position is not None:
        np.testing.assert_allclose(place.position, position)


def test_a_time_that_is_none_is_an_error():
    """NaN compares as neither before nor after: it would tell that the thing was not carried."""
    with pytest.raises(UserError, match="nan"):
        place_at(HISTORY, float("nan"))
    np.testing.assert_array_equal(place_at(HISTORY, float("inf")).position, SHELF)
    assert place_at((), 3.0) is None
    assert [clock(second) for second in (0, 9.99, 65, 3600)] == ["0:00", "0:09", "1:05", "60:00"]


def history(rests, links, features=(CUP,), query=CUP, step=10, **changes):
    """What a query means was carried, of a scene whose words are cup, box and hand. ``rests``: (thing, first second, last second,
    place) of each. ``links``: (thing, rest before, rest after) of each carry, in turn at 0, ``step`` ... s for five seconds."""
    first, count = step * np.arange(len(links)), len(links)
    arrays = {"first_frame": first, "last_frame": first + 5, "best_frame": first}
    arrays |= {"size": np.full(count, 0.1), "box": np.zeros((count, 4), np.int32)}
    carries = SimpleNamespace(read=lambda name: arrays[name.removeprefix("carries/")])
    things, begins, ends = np.array([one[:3] for one in rests], int).reshape(-1, 3).T
    changes |= {"center": np.array([one[3] for one in rests], float).reshape(-1, 3), "frame": begins}
    changes["links"] = np.array(links, np.int32).reshape(-1, 3).T
    looks = torch.stack([NOTHING, *features])[1:]
    made = make_rests(things, SECONDS[begins], SECONDS[ends], looks, **changes)
    words = Texts(("cup", "box", "hand"), torch.stack([CUP, BOX, HAND]), OBJECT[None])
    asked = Texts(("it",), query[None], OBJECT[None])
    return find_history(Histories(carries, made, SECONDS), asked, words, 10.0)


def spans(*given, **more):
    return [(one.from_s, one.until_s) for one in history(*given, **more)]


def told(*features, query=CUP):
    """When what a query means was taken up [s], of things each carried from table to desk, in turn at 0, 10, 20 ... s."""
    rests, links = [], []
    for thing, first in enumerate(10 * np.arange(len(features))):
        rests += [(thing, first, first, TABLE), (thing, first + 5, first + 5, DESK)]
        links.append((thing, 2 * thing, 2 * thing + 1))
    return [one.from_s for one in history(rests, links, features, query)]


def mixed(share, other):
    """A cup by this share, else another thing."""
    return torch.nn.functional.normalize(share * CUP + (1 - share) * other, dim=0)


def test_only_what_looks_most_like_the_query_is_its_history():
    box, half = mixed(0.4, BOX), mixed(0.6, HAND)
    assert told(box, half, CUP) == [20.0] and told(box, half) == [10.0]
    assert told(box) == told(mixed(0.4, OBJECT)) == told() == told(NOTHING) == []
    # The masks of a cup show more of the hand that holds it; nobody carries a hand about.
    assert told(mixed(0.4, HAND)) == [0.0] and told(HAND, query=HAND) == []
    for count in (0, 1):
        assert history([], [NO_LINK] * count, ()) == ()


def test_of_carries_at_one_time_the_longest_stays():
    # Two tracks end where one thing is put down.
    [(first, _)] = spans([(0, 9, 20, DESK)], [(0, -1, 0), (0, -1, 0)], step=3)
    assert first == 0.0
    # Frames may show a thing at its new place before it has left all frames of the old one: it is carried between these times.
    assert spans([(0, 0, 4, TABLE), (0, 3, 9, DESK)], [(0, 0, 1)]) == [(3, 4)]


def test_a_scene_tells_the_history_of_an_answer(tmp_path, page_scene, run_command):
    folder = shutil.copytree(page_scene, tmp_path / "scene")
    put_histories(folder)
    scene = open_scene(folder, min_score=0.7)
    cup, couch = scene.ask("cup", "couch")
    [carried] = cup.history
    np.testing.assert_array_equal([carried.start, carried.end], [TAKEN_UP, PUT_DOWN])
    times = carried.from_s, carried.until_s
    assert times == (pytest.approx(0.1), pytest.approx(0.2)) and carried.box == (10, 20, 30, 40)
    assert carried.score > 0.5 and couch.history == () and couch.at(0.0) is None

    def table(*words):
        given = ("query", folder, "cup", "couch", *words, "--overwrite")
        _, out, err = run_command(*given)
        return out.split("\n\n")[1].splitlines()[:-1] if "\n\n" in out else err

    assert [re.split(r"\s{2,}", line) for line in table()] == [
        ["carried thing", "carried [min:s]", "from [m]", "to [m]", "frame"],
        ["cup", "0:00 to 0:00", "-1.00, 0.00, 2.00", "1.00, 0.00, 2.00", "2"],
    ]
    assert re.split(r"\s{2,}", table("--at", "0:0.3")[1]) == ["cup", "1.00, 0.00, 2.00", "here from 0:00 on"]
    assert "give seconds, as 65" in table("--at", "soon")
    _, out, _ = run_command("query", folder, "couch", "--at", 0, "--overwrite")
    assert "nothing of this was carried, as far as is known" in out
    assert "the recording ends at 0:00" in table("--at", "0:01")
    assert "frame 1 has its own time" in table("--at", "0", "--frame", "1")
    assert "here from 0:00 on" in table("--at", "0:0.9")[1], "it is shown as 0:00, as the end is"


def test_a_thing_with_rests_is_told_from_rest_to_rest():
    places = [(0, 0, 1, TABLE), (0, 6, 9, DESK), (0, 17, 30, SHELF)]
    told = history(places, [(0, 0, 1), (0, 1, 2), NO_LINK])
    assert [(one.from_s, one.until_s) for one in told] == [(1, 6), (9, 17)]
    assert [place_at(told, second).carried for second in (1, 3, 7, 9, 20)] == [True, True, False, True, False]
    for second, position in ((0, TABLE), (7, DESK), (18, SHELF), (50, SHELF)):
        np.testing.assert_array_equal(place_at(told, second).position, position)


def test_a_place_that_is_seen_empty_or_that_a_track_alone_tells_is_not_known():
    """It lay on the table from second 6 to 9: seconds 3 and 14 show the table without it, and no carry is known."""
    told = history([(0, 6, 9, TABLE)], [NO_LINK], absent_s=np.array([[3.0], [14.0]]))
    assert [(one.from_s, one.until_s) for one in told] == [(3, 6), (9, 14)]
    places = [place_at(told, second).position for second in (1, 5, 7, 12, 20)]
    assert [place is not None for place in places] == [False, False, True, False, False]
    assert place_at(told, 5).told == "place unknown from 0:03 to 0:06", "a hand may only have hidden it"
    # The track ends at the desk, and no frame shows the thing at rest there.
    [one] = history([(0, 0, 4, TABLE)], [(0, 0, -1)])
    assert np.isfinite(one.start).all() and np.isnan(one.end).all()


def test_a_history_is_of_the_thing_that_fits_best():
    """Two cups are two things; a carry of no thing that rests is told by nobody, nor one that would join two."""
    rests = [(0, 6, 9, TABLE), (1, 16, 19, DESK)]
    links = [(0, -1, 0), (1, -1, 1), NO_LINK, (0, 0, -1)]
    worse = mixed(0.7, HAND)
    assert [until for _, until in spans(rests, links, (worse, mixed(0.9, HAND)))] == [16]
    told = history(rests, links, (worse, NOTHING))
    assert [(one.from_s, one.until_s) for one in told] == [(0, 6), (9, 35)]
    assert place_at(told, 7).position.tolist() == TABLE.tolist()


EDITED = [
    ({"carries__last_frame": [2, 99]}, "'carries/last_frame' tells of frame 99, and the recording has 5"),
    ({"carries__first_frame": [5, 1]}, "'carries/first_frame' tells of frame 5"),
    ({"carries__best_frame": [2, 2**40]}, "'carries/best_frame' tells of frame 1099511627776"),
    ({"carries__first_frame": [3, 2]}, "1 of 2 carries end before they begin"),
    ({"rests__until_frame": [1, 99]}, "'rests/until_frame' tells of frame 99"),
    ({"rests__absent_after": [-1, 5]}, "'rests/absent_after' tells of frame 5"),
    ({"rests__from_frame": [2, 2]}, "1 of 2 rests end before they begin"),
]


@pytest.mark.parametrize(("changes", "said"), EDITED)
def test_spans_outside_of_the_recording_are_damaged(tmp_path, page_scene, changes, said):
    folder = shutil.copytree(page_scene, tmp_path / "results/adt/scene1")
    put_histories(folder, **changes)
    with pytest.raises(UserError) as caught:
        open_scene(folder).ask("cup")
    message, path = str(caught.value), folder / "histories.zarr"
    with pytest.raises(UserError) if "rests" in said else contextlib.nullcontext():
        open_scene(folder).ask("cup", frame=0)
    assert message.startswith(f"{path}: {said}") and f"Rebuild it: rm -r {path} && snakemake" in message


@pytest.mark.parametrize("made_from", ["other Gaussians", "another OpenCLIP"])
def test_histories_of_something_else_tell_nothing(tmp_path, page_scene, made_from):
    """Places of before the Gaussians were trained again may be wrong; other features compare with no word."""
    folder = shutil.copytree(page_scene, tmp_path / "scene")
    if made_from == "another OpenCLIP":
        put_histories(folder, things__feature=np.full((1, 3), 3**-0.5, np.float32))
    else:
        nothing = {"carries/feature": np.zeros((0, 4), np.float32)}
        put(folder, "histories", nothing, inputs={"splats.zarr": "0" * 64})
    scene = open_scene(folder)
    assert scene.histories is None and scene.ask("cup")[0].history == ()
    assert (scene.rests is None) == (made_from == "other Gaussians")


@pytest.mark.parametrize(
    "given", ["nan", "1:nan", "inf", "-1", "1:-5", "-1:90", "1:2:3", "", ":", "9" * 400 + ":0"]
)
def test_times_on_the_command_line(given):
    assert [parse_time(None, None, one) for one in ("65", "1:05", "0:0.5", "61:00")] == [65, 65, 0.5, 3660]
    with pytest.raises(click.BadParameter, match="give seconds, as 65"):
        parse_time(None, None, given)
