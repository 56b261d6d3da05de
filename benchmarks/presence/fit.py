"""Fit the probability that an answer is right, and move it to another share of present things."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit, logit

from benchmarks.rows import EVIDENCE
from egosplat.query.calibrate import errors, fit_logistic
from egosplat.query.grades import log_odds, shift_log_odds
from egosplat.query.text import name_parts

Floats = NDArray[np.float64]


def judged(rows: pd.DataFrame) -> pd.DataFrame:
    """The queries that tell whether their answer is right, with ``true`` 0 or 1.

    Left out are words that the model was not taught, which never have an answer, answers that no frame verifies, and as absent
    things names of parts of present ones, such as "pillow" where a couch has cushions.
    """
    named = {scene: name_parts(own["phrase"]) for scene, own in rows[rows["present"] == 1].groupby("scene")}
    is_part = [
        phrase in named.get(scene, ()) for scene, phrase in zip(rows["scene"], rows["phrase"], strict=True)
    ]
    told = rows["right"].notna() | ((rows["present"] == 0) & ~np.array(is_part, bool))
    kept = rows[(rows["untaught"] == 0) & rows["apart"].notna() & told]
    # Rows of earlier texts have other evidence.
    return kept.assign(
        fit=kept["score"].map(log_odds), true=kept["right"].astype(float).fillna(0.0) * kept["present"]
    )


def at_share(p: pd.Series, rows: pd.DataFrame, share: float) -> tuple[pd.Series, pd.Series]:
    """Probabilities for a reader of whose words a share is there, and what each query counts for him."""
    present = rows["present"] == 1
    own, misplaced = errors(present, rows["true"])
    shifted = expit(logit(p) + shift_log_odds(own, misplaced, share))
    return shifted, present * share / own + ~present * (1 - share) / (1 - own)


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


def reliability(
    p: pd.Series, true: pd.Series, bins: int = 5
) -> Iterator[tuple[float, float, float, float, int]]:
    """Of each range of probabilities its bounds, mean probability, share of right answers, and number of queries."""
    for low, high in zip(np.linspace(0, 1, bins + 1)[:-1], np.linspace(0, 1, bins + 1)[1:], strict=True):
        mine = (p >= low) & ((p < high) | (high == 1))
        if mine.any():
            yield float(low), float(high), float(p[mine].mean()), float(true[mine].mean()), int(mine.sum())
