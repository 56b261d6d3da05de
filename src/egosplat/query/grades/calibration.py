"""Three answers: found, a best guess, not found, by the probability that an answer is right (docs/method.md#grades)."""

import csv
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from egosplat.pipeline.messages import figure
from egosplat.query.options import QueryOptions

FOUND, GUESS, NOT_FOUND = "found", "best guess", "not found"

NOTHING_LIKE_IT = "not found: nothing here looks like it"

# A row for each OpenCLIP with a fit: its hash, the keys that it holds for, what ``Calibration`` has.
FITS = Path(__file__).with_name("fits.csv")

# Keys of ``query`` that move a thing's score, or are a limit of the user's own: a fit holds for the values it was made with.
HELD = ("canonical", "temperature", "box_filter", "segmentation_threshold", "min_score")


@dataclass(frozen=True)
class Evidence:
    """What tells whether a thing is what a query means.

    Attributes:
        size: logarithm of its share of the view that shows it best.
        lead: log-odds of its mean relevancy, less those of the best word of ``egosplat.query.vocabulary`` that means something
            else.
        apart: its score less the best score of another thing that matches the query; 0 stands for none.
    """

    size: float
    lead: float
    apart: float


@dataclass(frozen=True)
class Calibration:
    """A logistic regression of whether answers were right, and two limits of its probability.

    Attributes:
        weights: of the fields of ``Evidence``, by name.
        found: least probability of an answer that is found.
        guess: least probability of a best guess.
    """

    intercept: float
    weights: Mapping[str, float]
    found: float
    guess: float

    def probability(self, evidence: Evidence) -> float:
        """Probability that a thing is what the query means."""
        values = asdict(evidence)
        return logistic(self.intercept + sum(weight * values[name] for name, weight in self.weights.items()))


@dataclass(frozen=True)
class Grading:
    """How answers are graded: by their probability where a calibration holds, else by their score.

    Attributes:
        calibration: None where none holds.
        least: ``query.min_score``, the least score of an answer that is found without a calibration.
    """

    calibration: Calibration | None
    least: float

    @property
    def measure(self) -> str:
        """Name of what is graded."""
        return "score" if self.calibration is None else "probability"

    @property
    def notice(self) -> str | None:
        """A line for where no calibration holds."""
        if self.calibration is not None:
            return None
        return (
            f"not calibrated: an answer is found from a score of {self._limit}, and there are no best guesses"
        )

    @property
    def _limit(self) -> str:
        # All its digits, two at least: a rounded limit would contradict the verdict.
        return max(f"{self.least:.2f}", f"{self.least:g}", key=len)

    def grade(self, value: float) -> str:
        """Grade a probability, or without a calibration a score."""
        fit = self.calibration
        if fit is None:
            return FOUND if value >= self.least else NOT_FOUND
        return FOUND if value >= fit.found else GUESS if value >= fit.guess else NOT_FOUND

    def shown(self, value: float) -> str:
        """A graded number with two decimals, which have its grade."""
        return figure(value, ".2f", self.grade)

    def refusal(self, value: float) -> str | None:
        """Why an answer is not found; None if it is found or a best guess."""
        if self.grade(value) != NOT_FOUND:
            return None
        if self.calibration is not None:
            return NOTHING_LIKE_IT
        return f"not found: the best match is below {self._limit}"


def logistic(x: float) -> float:
    """The logistic function, which does not overflow."""
    return 0.5 * (1.0 + math.tanh(0.5 * x))


def log_odds(p: float) -> float:
    """Its inverse; probabilities of 0 and 1 count as 1e-6 and 1 - 1e-6."""
    p = min(max(p, 1e-6), 1 - 1e-6)
    return math.log(p / (1 - p))


def grading_of(clip_hash: str, options: QueryOptions) -> Grading:
    """The grading of answers that an OpenCLIP gives; a calibration holds for the options it was made with."""
    row = read_fits().get(clip_hash)
    if row is None or held_keys(options) != {name: row[name] for name in HELD}:
        return grading_by_score(options)
    weights = {name: float(row[name]) for name in Evidence.__dataclass_fields__}
    numbers = (float(row[name]) for name in ("found", "guess"))
    return Grading(Calibration(float(row["intercept"]), weights, *numbers), options.min_score)


def grading_by_score(options: QueryOptions) -> Grading:
    """The grading of answers in one view, and of models that no calibration holds for."""
    return Grading(None, options.min_score)


def held_keys(options: QueryOptions) -> dict[str, str]:
    """The values of ``HELD``, as ``FITS`` has them."""
    return {
        name: " ".join(value) if isinstance(value := getattr(options, name), tuple) else f"{value:g}"
        for name in HELD
    }


@cache
def read_fits() -> dict[str, dict[str, str]]:
    """The rows of ``FITS`` by the hash of their OpenCLIP."""
    with FITS.open(newline="", encoding="utf-8") as lines:
        return {row["clip"]: row for row in csv.DictReader(lines)}
