"""Fit the probability that an answer is right, and the limits of the three grades."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit

from benchmarks.rows import EVIDENCE

# Penalty on the squares of the weights, but for the intercept: it keeps them finite where a scene has no wrong answer.
RIDGE = 0.1

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Least probabilities of the grades ``found`` and ``best guess``."""

    found: float
    guess: float


# At most this share of absent things is found, and at least this share of the best guesses for present things is right.
ABSENT_FOUND, GUESS_RIGHT = 0.03, 0.5

# Least limits, whatever the data: what is found is more probably right than not, and a guess is right once in four.
LEAST = Limits(found=0.5, guess=0.25)


def judged(rows: pd.DataFrame) -> pd.DataFrame:
    """The queries that tell whether their answer is right, with ``true`` 0 or 1.

    Left out are words that the model was not taught, which never have an answer, and answers that no frame verifies.
    """
    kept = rows[
        (rows["untaught"] == 0) & rows["lead"].notna() & ((rows["present"] == 0) | rows["right"].notna())
    ]
    return kept.assign(true=kept["right"].astype(float).fillna(0.0) * kept["present"])


def fit_logistic(x: Floats, y: Floats) -> Floats:
    """Intercept and weights (1 + F,) of a logistic regression of (N,) 0 or 1 on (N, F), by Newton's method."""
    design = np.column_stack([np.ones(len(x)), x])
    penalty = RIDGE * np.diag([0.0] + [1.0] * x.shape[1])
    found = np.zeros(design.shape[1])
    for _ in range(50):
        p = expit(design @ found)
        curvature = (design * (p * (1 - p))[:, None]).T @ design + penalty + 1e-9 * np.eye(len(penalty))
        found = found - np.linalg.solve(curvature, design.T @ (p - y) + penalty @ found)
    return found


def predict(weights: Floats, x: Floats) -> Floats:
    """(N,) probabilities."""
    return expit(weights[0] + x @ weights[1:])


def held_out(rows: pd.DataFrame, names: Sequence[str] = EVIDENCE) -> pd.Series:
    """The probability of each row, by a fit on the rows of all other scenes."""
    found = pd.Series(np.nan, index=rows.index)
    for scene in rows["scene"].unique():
        mine = rows["scene"] == scene
        others = rows[~mine]
        weights = fit_logistic(others[[*names]].to_numpy(float), others["true"].to_numpy(float))
        found[mine] = predict(weights, rows.loc[mine, [*names]].to_numpy(float))
    return found


def log_loss(p: pd.Series, true: pd.Series) -> float:
    """Mean negative log-likelihood."""
    p = p.clip(1e-6, 1 - 1e-6)
    return float(-(true * np.log(p) + (1 - true) * np.log(1 - p)).mean())


def brier(p: pd.Series, true: pd.Series) -> float:
    """Mean squared difference of probability and outcome."""
    return float(((p - true) ** 2).mean())


def choose_limits(p: pd.Series, rows: pd.DataFrame) -> Limits:
    """The least limits, in hundredths, that keep ``ABSENT_FOUND``, ``GUESS_RIGHT`` and ``LEAST``."""
    steps, present = np.arange(1, 102) / 100, rows["present"] == 1
    found = next(one for one in steps if one >= LEAST.found and (p[~present] >= one).mean() <= ABSENT_FOUND)

    def is_useful(least: float) -> bool:
        guessed = rows["true"][present & (p >= least) & (p < found)]
        return len(guessed) > 0 and guessed.mean() >= GUESS_RIGHT

    return Limits(
        float(found),
        float(next((one for one in steps if LEAST.guess <= one < found and is_useful(one)), found)),
    )


def reliability(
    p: pd.Series, true: pd.Series, bins: int = 5
) -> Iterator[tuple[float, float, float, float, int]]:
    """Of each range of probabilities its bounds, mean probability, share of right answers, and number of queries."""
    for low, high in zip(np.linspace(0, 1, bins + 1)[:-1], np.linspace(0, 1, bins + 1)[1:], strict=True):
        mine = (p >= low) & ((p < high) | (high == 1))
        if mine.any():
            yield float(low), float(high), float(p[mine].mean()), float(true[mine].mean()), int(mine.sum())
