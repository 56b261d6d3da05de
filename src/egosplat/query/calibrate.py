"""Fit the probability that an answer is right; by judgements of a user with ``egosplat calibrate``."""

import csv
from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import expit

from egosplat.arrays import Array
from egosplat.errors import UserError
from egosplat.files import read_user_text, write_text
from egosplat.pipeline.home import OWN_FITS
from egosplat.query.answers import Evidence
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import held_keys, is_contested, read_fits
from egosplat.query.options import QueryOptions

# A file of judgements: the best answer to a phrase is right or wrong, or the thing is absent.
COLUMNS, KINDS = ["phrase", "label"], ("right", "wrong", "absent")

# Fewest judgements, and fewest right ones and absent ones among them: four weights follow from them.
LEAST, LEAST_OF_A_KIND = 20, 5

# Penalty on the squares of the weights, but for the intercept: it keeps them finite without a wrong answer.
RIDGE = 0.1


def fit_logistic(x: Array, y: Array) -> Array:
    """Intercept and weights (1 + F,) of a logistic regression of (N,) 0 or 1 on (N, F), by Newton's method."""
    design = np.column_stack([np.ones(len(x)), x])
    penalty = RIDGE * np.diag([0.0] + [1.0] * x.shape[1])
    found = np.zeros(design.shape[1])
    for _ in range(50):
        p = expit(design @ found)
        curvature = (design * (p * (1 - p))[:, None]).T @ design + penalty + 1e-9 * np.eye(len(penalty))
        found = found - np.linalg.solve(curvature, design.T @ (p - y) + penalty @ found)
    return found


def errors(present: Array, right: Array) -> tuple[float, float]:
    """The share of queries whose thing is there, and of wrong answers the share of those to these, or 0."""
    wrong = present[right == 0]
    return float(present.mean()), float(wrong.mean()) if len(wrong) else 0.0


def write_fit(
    path: Path, about: tuple[str, QueryOptions, str], evidence: Array, right: Array, present: Array
) -> str:
    """Write a fit into a file of fits, in place of the last one of its OpenCLIP; ``about`` is that, the options
    and where it is from. Answers have (N, 4) evidence; 1 are those that are right, and those whose thing is there. Returns their
    numbers in words (UserError: they are too few)."""
    clip, options, scenes = about
    count = [int(each.sum()) for each in (right, present - right, 1 - present)]
    told = ", ".join(f"{number} {kind}" for number, kind in zip(count, KINDS, strict=True))
    if len(right) < LEAST or min(count[0], count[2]) < LEAST_OF_A_KIND:
        least = f"give {LEAST} or more, {LEAST_OF_A_KIND} of them right and {LEAST_OF_A_KIND} absent"
        raise UserError(f"{scenes}: judges {len(right)} phrases that have an answer, {told}; {least}")
    names = ("intercept", *Evidence.__dataclass_fields__, "present_share", "misplaced")
    values = (*fit_logistic(evidence, right), *errors(present, right))
    numbers = {name: f"{value:.4f}" for name, value in zip(names, values, strict=True)}
    row = {"clip": clip} | held_keys(options) | numbers | {"scenes": scenes}
    row["contested"] = "yes" if is_contested(clip, read_fits()) else ""
    rows = (read_fits(path) if path.exists() else {}) | {clip: row}
    write_text(path, pd.DataFrame([*rows.values()]).to_csv(index=False))
    return told


def run(scene: Scene, labels: Path) -> Iterator[str]:
    """Fit the grades of a scene to a file of judgements, and keep the fit in its folder; yield what was fitted
    (UserError: as ``read_labels``, or too few of its phrases have an answer)."""
    judged = read_labels(labels)
    answers = [one for one in scene.answers(judged) if one.candidates and not one.untaught]
    kinds = np.array([judged[one.phrase] for one in answers])
    path, about = scene.folder / OWN_FITS, (scene.encoded.facts["clip"]["hash"], scene.options, str(labels))
    evidence = np.array([astuple(one) for each in answers if (one := each.candidates[0].evidence)])
    told = write_fit(path, about, evidence, (kinds == "right").astype(int), (kinds != "absent").astype(int))
    yield f"{path}: fitted to {told}"
    yield "Queries take it from now on, the page when it is written anew, other scenes of this OpenCLIP with a copy."


def read_labels(path: Path) -> dict[str, str]:
    """The judgement of each phrase in a CSV file with ``COLUMNS`` (UserError: names the line that is none)."""
    lines, found = csv.reader(read_user_text(path).splitlines()), dict[str, str]()
    if (head := next(lines, [])) != COLUMNS:
        wrong = f"begins with {','.join(head)[:80]!r}, and not with the columns {','.join(COLUMNS)}"
        raise UserError(f"{path}: {wrong}")
    for cells in filter(None, lines):
        phrase, label = cells if len(cells) == len(COLUMNS) else ("", "")
        if label not in KINDS or not phrase.strip() or found.setdefault(phrase, label) != label:
            what = f"is no phrase with one of {', '.join(KINDS)}, or has another one above"
            raise UserError(f"{path}: line {lines.line_num}, {','.join(cells)[:80]!r}, {what}")
    return found
