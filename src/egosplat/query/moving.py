"""Answer queries by the tracks of what moves, which is masked and has no Gaussians (docs/answers.md#seen-moving)."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Array, Bools, Ints
from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Camera
from egosplat.language.vectors import unit
from egosplat.query.answers import Moving
from egosplat.query.grades import FOUND, LEAST_FIT, Evidence, Grading, fits_as_well, log_odds
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy
from egosplat.query.text import STAYING, WORDS, Texts, nearest_word, other_meanings

# Arms come from outside: this share of their masks, of so many at least, reaches the edge of what the camera shows.
_AT_EDGE, _LEAST_VIEWS = 0.8, 15
# What stands still has directions that vary less in the world than this share of their variance before the camera.
_STILL = 0.6
# Least rating: masks of what moves show parts, and are named worse than things in 3D.
_LEAST_RATING = 0.9
# What no training frame shows for longer than this is gone meanwhile [s].
_GAP_S = 1.0


@dataclass(frozen=True, eq=False)
class Tracks:
    """What is masked because it moves: T tracks, and V views of them in training frames.

    Attributes:
        number, feature: (T,) int64 instance in instances.zarr, and (T, D) float32 of unit norm.
        worn: (T,) bool, whether it is of the wearer.
        track, frame, share: (V,) of each view the row of its track, its frame, and the share of the frame that it fills.
    """

    number: Ints
    feature: Tensor
    worn: Bools
    track: Ints
    frame: Ints
    share: Array

    @staticmethod
    def read(
        masks: Artifact, views: Artifact, features: Artifact, camera: Camera, poses: Array, valid: Bools
    ) -> "Tracks":
        """Read the masked tracks but those that stand still, by the (F, 4, 4) poses of the frames, NaN without one, and the (H, W)
        pixels that the camera shows; ``views`` are view_features.zarr."""
        instance, frame, box, area = (views.read(name) for name in ("instance", "frame", "box", "area"))
        kept = masks.read("instances/transient")[instance] & np.isfinite(poses[frame]).all(axis=(1, 2))
        number, track = np.unique(instance[kept], return_inverse=True)
        frame, box, count = frame[kept].astype(np.int64), box[kept], np.bincount(track)
        x, y = ((box[:, :2] + box[:, 2:]) / 2 - (camera.cx, camera.cy)).T
        local = unit(np.stack([x / camera.fx, y / camera.fy, np.ones(len(box))], axis=1))
        world = np.einsum("vij,vj->vi", poses[frame][:, :3, :3], local)
        moves = _variance(world, track) >= _STILL * _variance(local, track)
        outside = np.pad(~valid, 1, constant_values=True)
        at_edge = [outside[top : end + 2, left : right + 2].any() for left, top, right, end in box.tolist()]
        worn = (np.bincount(track, at_edge) >= _AT_EDGE * count) & (count >= _LEAST_VIEWS)
        chosen, row = moves[track], np.cumsum(moves) - 1
        feature = torch.from_numpy(unit(features.read("consistent")[number[moves]])).float()
        views_of = row[track[chosen]], frame[chosen], area[kept][chosen] / valid.size
        return Tracks(number[moves].astype(np.int64), feature, worn[moves], *views_of)

    def find(
        self, query: Texts, words: Texts, seconds: Array, grading: Grading, options: QueryOptions
    ) -> Moving | None:
        """Find the wearer for one of ``WEARER``, else the tracks that fit one query better than every word that means something else;
        None unless these are certain. ``seconds`` are the (F,) times of the frames."""
        if query.phrases[0].lower() in WORDS["wearer"] and self.worn.any():
            return self._moving(self.worn, None, seconds)
        meant = nearest_word(query, words)
        if meant is None or (meant in STAYING and meant not in WORDS["wearer"]):
            return None
        others = words.queries[other_meanings(query, words)]
        fits = relevancy(self.feature, query, options.temperature)[:, 0].numpy().astype(np.float64)
        named = ~fits_as_well(self.feature, query.queries[0], others).numpy() & (fits > LEAST_FIT)
        chosen = ~self.worn & named
        shown = chosen[self.track]
        if len(np.unique(self.frame[shown])) < _LEAST_VIEWS:
            return None
        largest = self.share[shown].max()
        weight = np.bincount(self.track[shown], self.share[shown], len(chosen))
        fit = float(weight @ fits / weight.sum())
        rating = fit * largest / (largest + options.box_filter**2)
        if (fitted := grading.calibration) is not None:
            rivals = Texts(query.phrases, others, query.canonical)
            others_fit = relevancy(self.feature, rivals, options.temperature).amax(dim=1).clamp(min=0.5)
            lead = log_odds(fit) - log_odds(float(weight @ others_fit.numpy() / weight.sum()))
            rating = fitted.probability(Evidence(1.0, log_odds(fit), rating, lead))
        certain = rating >= _LEAST_RATING and grading.grade(rating) == FOUND
        return self._moving(chosen, rating, seconds) if certain else None

    def _moving(self, chosen: Bools, rating: float | None, seconds: Array) -> Moving:
        shown = chosen[self.track]
        frame, times = self.frame[shown], seconds[np.unique(self.frame[shown])]
        # The largest mask may have slipped to what is behind.
        large = np.argsort(self.share[shown], kind="stable")[3 * len(frame) // 4]
        runs = np.split(times, np.flatnonzero(np.diff(times) > _GAP_S) + 1)
        spans = tuple((float(run[0]), float(run[-1])) for run in runs)
        return Moving(rating, int(frame[large]), self.number[chosen], spans)


def _variance(directions: Array, track: Ints) -> Array:
    """(T,) variance of (V, 3) directions of each track, 0 to 1."""
    total = np.stack([np.bincount(track, axis) for axis in directions.T], axis=1)
    return 1.0 - np.linalg.norm(total, axis=1) / np.bincount(track)
