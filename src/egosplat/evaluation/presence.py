"""Query the whole scene for present and for absent things, and score which queries are answered."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import rankdata

from egosplat.evaluation.evaluation_frames import Evaluation, Frame
from egosplat.evaluation.queries import Query
from egosplat.frames.recording import Instance
from egosplat.gaussians.render import view_of
from egosplat.geometry import Camera
from egosplat.query.answers import Thing
from egosplat.query.finished_scene import Scene
from egosplat.query.grades.calibration import FOUND, GUESS, Evidence
from egosplat.query.scene import QueryScene, rendering_camera
from egosplat.rasterize.view import composite

# Longer side of the views that compare things with annotations [px]: shares of a thing need no more detail.
LABEL_SIDE = 256

# Minimum area of a thing in all evaluation frames together, at that size [px]; smaller ones are not compared.
LEAST_PIXELS = 4.0


@dataclass(frozen=True)
class PresenceQuery:
    """One query of the whole scene.

    Attributes:
        present: whether the recording shows such a thing.
        score, evidence: of the best thing; 0 and None without any.
        grade, probability: see ``egosplat.query.grades.calibration``.
        untaught: whether the model was not trained on one of its words.
        right: whether most of the best thing belongs to the category; None for absent phrases, without any thing, and
            if no evaluation frame shows the thing.
    """

    phrase: str
    present: bool
    score: float
    grade: str
    probability: float | None
    evidence: Evidence | None
    untaught: bool
    right: bool | None

    @property
    def answered(self) -> bool:
        """Whether something is found, not merely guessed."""
        return self.grade == FOUND


def presence_phrases(
    queries: Sequence[Query], instances: Sequence[Instance], negatives: Sequence[str]
) -> tuple[list[str], list[str]]:
    """The sorted categories of the queries, and the negatives that are no category of the recording, in their order."""
    known = {instance.category for instance in instances}
    return sorted({query.category for query in queries}), [one for one in negatives if one not in known]


def ask_presence(
    present: Sequence[str], absent: Sequence[str], evaluation: Evaluation, scene: Scene
) -> list[PresenceQuery]:
    """Query the whole scene for present and for absent things, see ``presence_phrases``."""
    if not (phrases := [*present, *absent]):
        return []
    answers = scene.ask(*phrases, most=1)
    best = {one.phrase: one.candidates[0] for one in answers[: len(present)] if one.candidates}
    shares, names = annotated_shares(scene.trained, list(best.values()), evaluation)
    right = {phrase: is_right(row, names, phrase) for phrase, row in zip(best, shares, strict=True)}
    return [
        PresenceQuery(
            phrase=answer.phrase,
            present=number < len(present),
            score=answer.score,
            grade=answer.grade,
            probability=answer.probability,
            evidence=next(iter(scene.evidence(answer.phrase, answer.candidates)), None),
            untaught=bool(answer.untaught),
            right=right.get(answer.phrase) if number < len(present) else None,
        )
        for number, answer in enumerate(answers)
    ]


def presence_entry(queries: Sequence[PresenceQuery], min_score: float) -> dict[str, Any]:
    """The entry ``presence`` of ``metrics.json``."""
    present, absent = ([one for one in queries if one.present is value] for value in (True, False))
    # Untaught words are refused at any score, so their scores say nothing about the limit.
    taught = [one.score for one in absent if not one.untaught]
    guessed = [one for one in queries if one.grade == GUESS]
    return {
        "min_score": min_score,
        "separation": separation([one.score for one in present], taught),
        "present": {
            "asked": len(present),
            "answered": sum(one.answered for one in present),
            "right": sum(one.answered and one.right is True for one in present),
            "unverified": sum(one.answered and one.right is None for one in present),
            "guessed": sum(one.present for one in guessed),
            "guessed_right": sum(one.right is True for one in guessed),
        },
        "absent": {
            "asked": len(absent),
            "answered": sum(one.answered for one in absent),
            "untaught": sum(one.untaught for one in absent),
            "guessed": sum(not one.present for one in guessed),
        },
        "queries": [asdict(one) | {"answered": one.answered} for one in queries],
    }


def annotated_shares(
    scene: QueryScene, things: Sequence[Thing], evaluation: Evaluation
) -> tuple[NDArray[np.float64], list[str]]:
    """Measure how many pixels of each of T things lie on each annotated category, over the evaluation frames.

    Returns:
        (T, C + 1) float64 pixels, the last column without annotation; names of the C categories.
    """
    names = sorted({one.category for one in evaluation.instances})
    total = np.zeros((len(things), len(names) + 1))
    if not things:
        return total, names
    camera = rendering_camera(evaluation.camera, LABEL_SIDE)
    # 1 where a Gaussian belongs to a thing.
    members = torch.zeros(scene.gaussians.count, len(things))
    for column, thing in enumerate(things):
        members[torch.from_numpy(thing.members), column] = 1.0
    members = members.to(scene.code.device)
    # Frames without an annotation would count all their pixels as no category.
    for frame in (one for one in evaluation.frames if one.asked):
        category = _category_map(evaluation, frame, names, camera)
        pose = evaluation.camera_to_world[frame.index]
        with torch.inference_mode():
            filled, _ = composite(view_of(scene.gaussians, camera, pose, scene.settings), members)
        pixels, counted = filled.cpu().numpy().reshape(-1, len(things)), category.ravel() >= 0
        onehot = np.eye(len(names) + 1)[category.ravel()[counted]]
        total += pixels[counted].T.astype(np.float64) @ onehot
    return total, names


def is_right(shares: NDArray[np.float64], names: Sequence[str], category: str) -> bool | None:
    """Whether most of a thing, a (C + 1,) row of ``annotated_shares``, is of a category; None if too little is visible."""
    # A few pixels at the border of a frame decide nothing.
    if shares.sum() < LEAST_PIXELS or category not in names:
        return None
    return bool(shares[list(names).index(category)] > 0.5 * shares.sum())


def separation(present: Sequence[float], absent: Sequence[float]) -> float:
    """Area under the ROC curve: how often a present thing scores higher than an absent one; NaN if either is empty."""
    if not len(present) or not len(absent):
        return float("nan")
    ranks = rankdata(np.concatenate([present, absent]))[: len(present)]
    return float((ranks.mean() - (len(present) + 1) / 2) / len(absent))


def _category_map(
    evaluation: Evaluation, frame: Frame, names: Sequence[str], camera: Camera
) -> NDArray[np.int64]:
    """(h, w) int64 category at each pixel center of a smaller camera; C for none, -1 for people and invalid pixels."""
    # Pixels of people do not count: people are masked in training, so the Gaussians do not show them.
    index = [
        -1 if one.instance_type == "human" else names.index(one.category) for one in evaluation.instances
    ]
    lookup = np.array([*index, len(names)], np.int16)
    full = np.where(evaluation.valid, lookup[evaluation.map_of(frame)], np.int16(-1))
    size = camera.width, camera.height
    return cv2.resize(full, size, interpolation=cv2.INTER_NEAREST_EXACT).astype(np.int64)
