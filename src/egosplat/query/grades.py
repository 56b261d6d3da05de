"""The one verdict on a query, for terminal, page, server, exports, movies and scores: found, a best guess or not found, by the
probability that an answer is right (docs/answers.md#grades)."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.histories.known import Histories
from egosplat.histories.told import Carried
from egosplat.pipeline.home import OWN_FITS
from egosplat.query.answers import Answer, Evidence, Thing, ViewMatch
from egosplat.query.options import HELD, QueryOptions
from egosplat.query.relevancy import relevancy
from egosplat.query.text import CARRIED, Texts, nearest_word, other_meanings

# Words of a query that are not known, and what is told of them, as of ``text.explain_untaught``.
Unknown = tuple[tuple[str, ...], str | None]

FOUND, GUESS, MOVING, NOT_FOUND = "found", "best guess", "seen moving", "not found"
# Of a text that is no query, which no grading gives.
NOT_ASKED = "not asked"

NOTHING_LIKE_IT = "not found: nothing here looks like it"

# Least probabilities of what is found and of a best guess: right in two of three cases at worst, and in one of four.
LEAST_FOUND, LEAST_GUESS = 2 / 3, 1 / 4

# A row for each OpenCLIP with a fit: its hash, the keys that it holds for, what ``Calibration`` has; and of the queries that it
# was made with the share whose thing was there, of wrong answers the share of those to these, and whether words of homes competed.
FITS = Path(__file__).with_name("fits.csv")

# Relevancy from which a thing may be what a query means: it is as like the query as the most alike canonical phrase.
LEAST_FIT = 0.5


@dataclass(frozen=True)
class Calibration:
    """A logistic regression of whether answers are right, by weights of the fields of ``Evidence``, for a reader of whose words
    ``present_share`` name what is in the scene."""

    intercept: float
    weights: Mapping[str, float]
    present_share: float

    def probability(self, evidence: Evidence) -> float:
        """Probability that a thing is what the query means."""
        values = asdict(evidence)
        x = self.intercept + sum(weight * values[name] for name, weight in self.weights.items())
        # The logistic function, which does not overflow in this form.
        return 0.5 * (1.0 + math.tanh(0.5 * x))


@dataclass(frozen=True)
class Grading:
    """How answers are graded by a ``measure``, 0 to 1: the least of what is found, and of a best guess.

    A ``notice`` says what that means; what is told ``below`` may have the value in braces."""

    measure: str
    found: float
    guess: float
    notice: str
    below: str = NOTHING_LIKE_IT
    calibration: Calibration | None = None

    def grade(self, value: float) -> str:
        """Grade a value of the measure."""
        return FOUND if value >= self.found else GUESS if value >= self.guess else NOT_FOUND

    def shown(self, value: float) -> str:
        """A graded number with two decimals, which have its grade also where rounding crosses a limit."""
        texts = [f"{round(value, 2) + step:.2f}" for step in (0.0, -0.01, 0.01)]
        return next((text for text in texts if self.grade(float(text)) == self.grade(value)), texts[0])

    def refusal(self, value: float) -> str | None:
        """Why an answer is not found; None if it is found or a best guess."""
        return self.below.format(self.shown(value)) if self.grade(value) == NOT_FOUND else None


def by_probability(fit: Calibration) -> Grading:
    """Grades by the probability of a calibration."""
    share = f"if {fit.present_share:.0%} of the words asked name something in the scene (query.present_share)"
    notice = f"found: right in at least 2 of 3 cases, best guess: in 1 of 4, {share}"
    return Grading("probability", LEAST_FOUND, LEAST_GUESS, notice, calibration=fit)


def by_score(least: float) -> Grading:
    """Grades by the score alone, of which ``query.min_score`` is the ``least``."""
    # All its digits, two at least: a rounded limit would contradict the verdict.
    limit = max(f"{least:.2f}", f"{least:g}", key=len)
    notice = f"not calibrated: an answer is found from a score of {limit}, and there are no best guesses"
    return Grading("score", least, least, notice, f"not found: the best match is below {limit}")


# Grades where nobody has calibrated an OpenCLIP, by how a query stands among words of homes (egosplat.query.contest).
_CALIBRATE = "egosplat calibrate SCENE labels.csv fits grades to your judgements"
_NOTICE = f"not calibrated: an answer has to win against a thousand words of homes; {_CALIBRATE}"
AMONG_WORDS = Grading("score", 0.9, 0.5, _NOTICE, "not found: other words of homes fit better everywhere")


def log_odds(p: float) -> float:
    """Inverse of the logistic function; probabilities of 0 and 1 count as 1e-6 and 1 - 1e-6."""
    p = min(max(p, 1e-6), 1 - 1e-6)
    return math.log(p / (1 - p))


def grading_of(clip_hash: str, options: QueryOptions, scene: Path | None = None) -> Grading:
    """The grading of answers that an OpenCLIP gives, in a scene's folder. A calibration holds for the options it
    was made with, the scene's own before that of all (UserError: the scene's is damaged)."""
    shipped = read_fits()
    own = read_fits(scene / OWN_FITS) if scene and (scene / OWN_FITS).exists() else {}
    for row in (fits[clip_hash] for fits in (own, shipped) if clip_hash in fits):
        if held_keys(options) == {name: row[name] for name in HELD}:
            return by_probability(_calibration(row, options.present_share))
    return AMONG_WORDS if is_contested(clip_hash, shipped) else by_score(options.min_score)


def is_contested(clip_hash: str, shipped: Mapping[str, Mapping[str, str]]) -> bool:
    """Whether answers of an OpenCLIP have to win among words of homes; a ``shipped`` fit that was made to such answers keeps them."""
    return shipped.get(clip_hash, {"contested": "yes"}).get("contested") == "yes"


def _calibration(row: Mapping[str, str], asked: float) -> Calibration:
    """The calibration of a row of ``FITS``, for a reader of whose words this share is there."""
    weights = {name: float(row[name]) for name in Evidence.__dataclass_fields__}
    shift = shift_log_odds(float(row["present_share"]), float(row["misplaced"]), asked)
    return Calibration(float(row["intercept"]) + shift, weights, asked)


def shift_log_odds(own: float, misplaced: float, asked: float) -> float:
    """What log-odds of a fit gain if a share ``asked`` of queries names what is there, in place of its ``own``: errors on what is absent
    become rarer by the ratio of the odds; the share ``misplaced``, on what is there, stays."""
    rarer = (1 - asked) / asked * own / (1 - own)
    # A fit without a wrong answer on what is there has no limit for who asks of that alone.
    return -math.log(max(misplaced + (1 - misplaced) * rarer, 1e-6))


def held_keys(options: QueryOptions) -> dict[str, str]:
    """The values of ``HELD``, as ``FITS`` has them."""
    numbers = {name: f"{getattr(options, name):g}" for name in HELD[1:]}
    return {"canonical": " ".join(options.canonical)} | numbers


def read_fits(path: Path | None = None) -> dict[str, dict[str, str]]:
    """The rows of ``FITS``, or of the file of a scene, by the hash of their OpenCLIP (UserError: that is damaged)."""
    with (path or FITS).open(newline="", encoding="utf-8", errors="replace") as lines:
        rows = [*csv.DictReader(lines)]
    try:
        return {row["clip"]: row for row in rows if [row[name] for name in HELD] and _calibration(row, 0.5)}
    except (ArithmeticError, KeyError, TypeError, ValueError):
        what = "is damaged; remove it, and run egosplat calibrate again"
        raise UserError(f"{path or FITS}: {what}") from None


def measure_evidence(
    things: Sequence[Thing], leads: Sequence[float], levels: Sequence[str]
) -> list[Evidence]:
    """Measure for each of the best things, compared with the others, the evidence that it is what a query means, by its lead and the
    levels from fine to coarse."""
    scores, measured = [thing.score for thing in things], []
    for row, thing in enumerate(things):
        apart = thing.score - max(scores[:row] + scores[row + 1 :], default=0.0)
        level = (levels.index(thing.level) + 1) / len(levels)
        measured.append(Evidence(level, log_odds(thing.score), apart, leads[row]))
    return measured


def find_history(histories: Histories, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
    """Find the carries of the thing that fits one query best, in the order of time.

    No word with another meaning, of what people carry, fits it better, and the query fits it as well as every canonical phrase. What
    stays has no carries; ``words`` are names of things, of which those of what people carry compete."""
    if not histories.things or nearest_word(query, words) not in CARRIED:
        return ()
    carried = torch.tensor([word in CARRIED for word in words.phrases])
    features, others = histories.features, words.queries[carried & other_meanings(query, words)]
    unnamed = fits_as_well(features, query.queries[0], others)
    scores = relevancy(features, query, temperature)[:, 0]
    score, best = scores.masked_fill(unnamed, 0.0).max(dim=0)
    if not score > LEAST_FIT:
        return ()
    return tuple(replace(one, score=float(score)) for one in histories.things[int(best)])


def fits_as_well(features: Tensor, own: Tensor, others: Tensor) -> Tensor:
    """(N,) bool, whether any of (W, D) other words fits (N, D) features as well as their own (D,) does."""
    return (features @ others.T >= (features @ own)[:, None]).any(dim=1)


def judge(
    phrase: str, things: Sequence[Thing], unknown: Unknown, grading: Grading, most: int, coded: bool = True
) -> Answer:
    """Judge the things that match a query of the whole scene, by decreasing score, with probabilities where a calibration holds, and show
    ``most`` of them. Words that the model was not trained on are ``unknown``; ``coded`` tells whether any Gaussian has a code."""
    untaught, refusal = unknown
    if not things:
        # What fits best may be specks alone.
        refusal = refusal or (NOTHING_LIKE_IT if coded else "no Gaussian of the scene has a code")
        return Answer(phrase, NOT_FOUND, 0.0, None, refusal, untaught)
    best = things[0]
    refusal = refusal or grading.refusal(best.rating)
    grade = NOT_FOUND if refusal else grading.grade(best.rating)
    # Nothing is shown of what is refused; what is found hides guesses.
    shown = [] if refusal else [one for one in things[:most] if grading.grade(one.rating) == grade]
    verdict = best.score, best.probability, refusal, untaught
    return Answer(phrase, grade, *verdict, things=tuple(shown), candidates=tuple(things))


def judge_view(match: ViewMatch, unknown: Unknown, grading: Grading) -> Answer:
    """Judge what matches in one view, by its score."""
    untaught, why = unknown
    refusal = why or ("nothing is visible here" if match.level is None else grading.refusal(match.score))
    shown, grade = (None, NOT_FOUND) if refusal else (match, FOUND)
    return Answer(match.phrase, grade, match.score, None, refusal, untaught, view=shown)
