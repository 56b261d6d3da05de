"""Query the whole scene for present and for absent things, and score which queries are answered."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np
import torch

from egosplat.arrays import Array
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.queries import Query
from egosplat.frames.recording import Instance
from egosplat.gaussians.render import view_of
from egosplat.query.answers import Thing
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import FOUND, GUESS
from egosplat.query.scene import QueryScene, rendering_camera
from egosplat.query.text import name_parts
from egosplat.rasterize.view import composite

# Longer side of the views that compare things with annotations [px]: shares of a thing need no more detail.
LABEL_SIDE = 256

# Minimum area of a thing in all evaluation frames together, at that size [px]; smaller ones are not compared.
LEAST_PIXELS = 4.0


def presence_phrases(
    queries: Sequence[Query], instances: Sequence[Instance], negatives: Sequence[str]
) -> tuple[list[str], list[str]]:
    """The sorted categories of the queries, and the negatives that are no category of the recording, nor a part of one, in their
    order."""
    known = {instance.category for instance in instances}
    known |= name_parts(known)
    absent = [phrase for phrase in negatives if phrase not in known]
    return sorted({query.category for query in queries}), absent


def ask_presence(
    present: Sequence[str], absent: Sequence[str], evaluation: Evaluation, scene: Scene
) -> list[dict[str, Any]]:
    """Query the whole scene for present and for absent things: an entry of ``metrics.json`` each; none of codes for views alone."""
    if not (phrases := [*present, *absent]) or scene.trained.maps_only:
        return []
    answers = list(scene.answers(phrases, most=1))
    best = {answer.phrase: answer.candidates[0] for answer in answers[: len(present)] if answer.candidates}
    shares, names = annotated_shares(scene.trained, list(best.values()), evaluation)
    right = {phrase: is_right(row, names, phrase) for phrase, row in zip(best, shares, strict=True)}
    entries = []
    for index, answer in enumerate(answers):
        evidence = answer.candidates[0].evidence if answer.candidates else None
        entries.append(
            {
                "phrase": answer.phrase,
                "present": index < len(present),
                "score": answer.score,
                "grade": answer.grade,
                "answered": answer.grade == FOUND,
                "probability": answer.probability,
                "evidence": evidence and asdict(evidence),
                "untaught": bool(answer.untaught),
                "right": right.get(answer.phrase) if index < len(present) else None,
            }
        )
    return entries


def presence_entry(queries: Sequence[Mapping[str, Any]], min_score: float) -> dict[str, Any]:
    """The entry ``presence`` of ``metrics.json``, from ``ask_presence``."""
    present = [query for query in queries if query["present"]]
    absent = [query for query in queries if not query["present"]]
    # Untaught words are refused at any score, so their scores say nothing about the limit.
    taught = [query["score"] for query in absent if not query["untaught"]]
    found, guesses = (
        [query["right"] for query in present if query["grade"] == grade] for grade in (FOUND, GUESS)
    )
    return {
        "min_score": min_score,
        "separation": separation([query["score"] for query in present], taught),
        "present": {
            "asked": len(present),
            "answered": len(found),
            "right": found.count(True),
            "unverified": found.count(None),
            "guessed": len(guesses),
            "guessed_right": guesses.count(True),
        },
        "absent": {
            "asked": len(absent),
            "answered": sum(query["answered"] for query in absent),
            "untaught": sum(query["untaught"] for query in absent),
            "guessed": sum(query["grade"] == GUESS for query in absent),
        },
        "queries": [*queries],
    }


def annotated_shares(
    scene: QueryScene, things: Sequence[Thing], evaluation: Evaluation
) -> tuple[Array, list[str]]:
    """Measure how many pixels of each of T things lie on each annotated category, over the evaluation frames: (T, C + 1)
    float64, the last column without annotation; and names of the C categories."""
    names = sorted({instance.category for instance in evaluation.instances})
    total = np.zeros((len(things), len(names) + 1))
    if not things:
        return total, names
    camera = rendering_camera(evaluation.camera, LABEL_SIDE)
    # 1 where a Gaussian belongs to a thing.
    members = torch.zeros(scene.gaussians.count, len(things))
    for column, thing in enumerate(things):
        members[torch.from_numpy(thing.members), column] = 1.0
    members = members.to(scene.code.device)
    # Pixels of people do not count: people are masked in training, so the Gaussians do not show them.
    columns = [
        -1 if instance.instance_type == "human" else names.index(instance.category)
        for instance in evaluation.instances
    ]
    lookup = np.array([*columns, len(names)], np.int16)
    # Frames without an annotation would count all their pixels as no category.
    for frame in filter(lambda frame: frame.asked, evaluation.frames):
        full = np.where(evaluation.valid, lookup[evaluation.map_of(frame)], np.int16(-1))
        category = cv2.resize(full, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST_EXACT)
        label = category.ravel().astype(np.int64)
        pose = evaluation.camera_to_world[frame.index]
        with torch.inference_mode():
            filled, _ = composite(view_of(scene.gaussians, camera, pose, scene.settings), members)
        pixels, counted = filled.cpu().numpy().reshape(-1, len(things)), label >= 0
        onehot = np.eye(len(names) + 1)[label[counted]]
        total += pixels[counted].T.astype(np.float64) @ onehot
    return total, names


def is_right(shares: Array, names: Sequence[str], category: str) -> bool | None:
    """Whether most of a thing, a (C + 1,) row of ``annotated_shares``, is of a category; None if too little is visible."""
    # A few pixels at the border of a frame decide nothing.
    if shares.sum() < LEAST_PIXELS or category not in names:
        return None
    return bool(shares[list(names).index(category)] > 0.5 * shares.sum())


def separation(present: Sequence[float], absent: Sequence[float]) -> float:
    """Area under the ROC curve: how often a present thing scores higher than an absent one; NaN if either is empty."""
    if not len(present) or not len(absent):
        return float("nan")
    # Equal scores count half.
    places = [np.searchsorted(np.sort(absent), present, side) for side in ("left", "right")]
    return float(np.mean(places) / len(absent))
