"""Tracks made wrong in part, as trackers make them."""

import numpy as np

from benchmarks.aggregation.tracks import Features, Tracks

KINDS = {
    "switched": "the tracker slips onto one other thing",
    "scattered": "each wrong view shows a different thing",
    "slid": "the mask slides off the thing",
}


def corrupted(tracks: Tracks, kind: str, share: float, rng: np.random.Generator) -> Features:
    """(R, D) features of which, of each thing, so large a share is wrong.

    Wrong things are of the same world and of another name.
    """
    features = tracks.feature.copy()
    for thing, name in enumerate(tracks.name):
        rows = np.flatnonzero(tracks.thing == thing)
        wrong = rng.permutation(rows)[: round(share * len(rows))]
        if kind == "slid":
            features[wrong] = tracks.shifted[wrong]
            continue
        others = np.flatnonzero((tracks.world == tracks.world[thing]) & (tracks.name != name))
        if len(others):
            chosen = (
                np.full(len(wrong), rng.choice(others))
                if kind == "switched"
                else rng.choice(others, len(wrong))
            )
            features[wrong] = (
                [_any_view(tracks, other, rng) for other in chosen] if len(wrong) else features[wrong]
            )
    return features


def _any_view(tracks: Tracks, thing: int, rng: np.random.Generator) -> Features:
    return tracks.feature[rng.choice(np.flatnonzero(tracks.thing == thing))]
