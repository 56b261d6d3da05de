"""The one verdict on a query, for terminal, page, server, exports, movies and scores (docs/method.md#grades)."""

from collections.abc import Sequence

from egosplat.query.answers import Answer, Thing, ViewMatch
from egosplat.query.grades.calibration import FOUND, NOT_FOUND, NOTHING_LIKE_IT, Grading
from egosplat.query.options import MOST
from egosplat.query.text import explain_untaught


def judge(
    phrase: str,
    candidates: Sequence[Thing],
    untaught: Sequence[str],
    grading: Grading,
    most: int = MOST,
    *,
    coded: bool = True,
) -> Answer:
    """Judge the things that match a query of the whole scene.

    Args:
        candidates: by decreasing score, with their probabilities where a calibration holds.
        untaught: words of the query that the model was not trained on.
        most: maximum number of things that are shown.
        coded: whether any Gaussian has a code.
    """
    refusal, untaught = explain_untaught(untaught), tuple(untaught)
    if not candidates:
        # What fits best may be specks alone.
        refusal = refusal or (NOTHING_LIKE_IT if coded else "no Gaussian of the scene has a code")
        return Answer(phrase, NOT_FOUND, 0.0, None, refusal, untaught)
    best = candidates[0]
    refusal = refusal or grading.refusal(best.rating)
    grade = NOT_FOUND if refusal else grading.grade(best.rating)
    # Nothing is shown of what is refused; what is found hides guesses.
    shown = () if refusal else (one for one in candidates[:most] if grading.grade(one.rating) == grade)
    return Answer(
        phrase, grade, best.score, best.probability, refusal, untaught, tuple(shown), tuple(candidates)
    )


def judge_view(match: ViewMatch, untaught: Sequence[str], grading: Grading) -> Answer:
    """Judge what matches in one view, by its score."""
    refusal = explain_untaught(untaught) or grading.refusal(match.score)
    shown = None if refusal or match.level is None else match
    grade = NOT_FOUND if refusal else FOUND
    return Answer(match.phrase, grade, match.score, None, refusal, tuple(untaught), view=shown)
