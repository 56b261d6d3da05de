"""Sightings of things on their ways, and rests between them."""

import itertools

import numpy as np

from egosplat.histories.known import Rests
from egosplat.histories.moves import find_carries
from egosplat.histories.sightings import SIGHTING

# Frames a second, and the size of the thing [m].
RATE, SIZE = 5, 0.2
HERE, THERE, BACK = np.array([0.0, 0.0, 2.0]), np.array([1.5, 0.0, 2.0]), np.array([0.0, 1.2, 2.0])


def way(*legs):
    """(S, 3) centers: each leg is a place and the number of frames there, with 10 frames of way in between."""
    parts = [np.tile(legs[0][0], (legs[0][1], 1))]
    for (place, _), (following, count) in itertools.pairwise(legs):
        steps = np.linspace(0, 1, 12)[1:-1, None]
        parts += [place + steps * (following - place), np.tile(following, (count, 1))]
    return np.concatenate(parts)


def sightings(*tracks, edge=0.0, size=SIZE):
    """Sightings of tracks, each (first frame, (S, 3) centers); the camera stands still at the origin."""
    rows = [
        (begin + place, number, 400, edge, center, center, size, (0, 0, 0, 0))
        for number, (begin, centers) in enumerate(tracks)
        for place, center in enumerate(centers)
    ]
    return np.array(sorted(rows, key=lambda row: row[:2]), SIGHTING).view(np.recarray)


def found(*tracks, inside=None, seconds=None, **more):
    """The carries among the sightings of tracks, by default at ``RATE``."""
    seen = sightings(*tracks, **more)
    return find_carries(seen, inside or {}, np.arange(200) / RATE if seconds is None else seconds)


def make_rests(thing, from_s, until_s, feature, **changes):
    """Rests of things at the origin, for their spans [s], which no carry is linked to."""
    count, nothing = len(thing), np.zeros(0, np.int64)
    values = {"gaussians": None, "rest": nothing, "thing": thing, "from_s": from_s, "until_s": until_s}
    values |= {"feature": feature, "absent_s": np.full((2, count), np.nan), "center": np.zeros((count, 3))}
    values |= {"size": np.full(count, 0.2), "frame": np.zeros(count, np.int64)}
    values |= {"box": np.zeros((count, 4), np.int32), "links": np.zeros((3, 0), np.int32)}
    return Rests(**values | changes)
