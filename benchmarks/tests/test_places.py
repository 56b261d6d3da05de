"""Where histories say that carried things lie."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.carries.places import places_of
from benchmarks.carries.truth import Rest


def rest(name: str, from_s: float, until_s: float, x: float) -> Rest:
    """A cup of 20 cm at this place."""
    pose = np.eye(4)
    pose[0, 3] = x
    return Rest(name, "cup", 1, from_s, until_s, pose, np.full(3, -0.1), np.full(3, 0.1))


@pytest.mark.parametrize(
    "x, told, right",
    [
        (None, [0, 0, 0], [0, 0, 0]),
        (0.34, [1, 1, 1], [1, 0, 1]),
        (2.0, [1, 1, 1], [1, 0, 1]),
        (9.0, [1] * 3, [0] * 3),
    ],
)
def test_a_place_is_right_near_any_thing_of_its_category_that_lies_there_then(x, told, right):
    """Two cups lie at 0 and 2 m, one of them later at 5 m."""
    rests = [rest("a", 0.0, 4.0, 0.0), rest("a", 6.0, 9.0, 5.0), rest("b", 0.0, 4.0, 2.0)]
    place = None if x is None else SimpleNamespace(position=np.array([x, 0.0, 0.0]))
    rows = [*places_of(rests, {"cup": SimpleNamespace(at=lambda _: place)})]
    assert [row[-2:] for row in rows] == [*zip(told, right, strict=True)]
    assert rows[1][:4] == ("a", "cup", 6.0, 9.0)
