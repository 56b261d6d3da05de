"""Where histories say that carried things lie, held against the truth: rows of ``places``."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.carries.truth import Rest, read_rests, recording_of
from egosplat.query.answers import Answer
from egosplat.query.finished_scene import Scene, open_scene

# An answer is right within this distance of the thing's box [m].
NEAR_M = 0.25

Place = tuple[str, str, float, float, int, int]


def read_places(folder: Path) -> list[Place]:
    """The ``places_of`` a finished scene; none if its recording does not tell where things are carried."""
    if not (recording_of(folder) / "truth" / "rests.tsv").is_file():
        return []
    scene = open_scene(folder)
    rests = rests_of(scene)
    names = sorted({one.category for one in rests})
    return [*places_of(rests, dict(zip(names, scene.ask(*names), strict=True)))]


def rests_of(scene: Scene) -> list[Rest]:
    """The true places of the carried things of a scene."""
    return read_rests(recording_of(scene.folder), scene.artifact("frames").read("timestamp_ns"))


def places_of(rests: Sequence[Rest], answers: Mapping[str, Answer]) -> Iterator[Place]:
    """Name, category, first and last second of each true place; and whether the history of the answer for its category tells a
    place in the middle of that time, and one where a thing of the category lies then."""
    for rest in rests:
        place = answers[rest.category].at((rest.from_s + rest.until_s) / 2)
        told = place is not None and place.position is not None
        right = told and any(distance(place.position, one) <= NEAR_M for one in there(rest, rests))
        yield rest.name, rest.category, rest.from_s, rest.until_s, int(told), int(right)


def there(rest: Rest, rests: Sequence[Rest]) -> list[Rest]:
    """The rests of things of its category in the middle of its time."""
    middle = (rest.from_s + rest.until_s) / 2
    return [one for one in rests if one.category == rest.category and one.from_s <= middle <= one.until_s]


def distance(point: np.ndarray, rest: Rest) -> float:
    """Distance of a point from the box of a rest [m]."""
    return float(rest.distances(point[None])[0])
