"""When a query has no answer, and why."""

from collections.abc import Sequence


def refusal(score: float, untaught: Sequence[str], min_score: float) -> str | None:
    """Say why a query has no answer; None where it has one.

    Args:
        score: of the best that was found, 0..1.
        untaught: words of the query that the model was not trained on.
        min_score: least score of an answer.
    """
    if untaught:
        words = ", ".join(f'"{word}"' for word in dict.fromkeys(untaught))
        return f"nothing of the kind: the OpenCLIP checkpoint was not trained on {words}"
    if score < min_score:
        return f"nothing of the kind: the best fit is below {min_score:.2f}"
    return None
