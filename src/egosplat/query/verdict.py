"""Refuse queries that have no answer."""

from collections.abc import Sequence


def refusal(score: float, untaught: Sequence[str], min_score: float) -> str | None:
    """The reason why a query has no answer; None if it has one.

    Args:
        score: score of the best match, 0..1.
        untaught: words of the query that the model was not trained on.
    """
    # First, because the score of an untrained word is meaningless.
    if untaught:
        words = ", ".join(f'"{word}"' for word in dict.fromkeys(untaught))
        return f"not found: the OpenCLIP checkpoint was not trained on {words}"
    if score < min_score:
        return f"not found: the best match is below {min_score:.2f}"
    return None
