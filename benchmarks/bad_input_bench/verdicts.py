"""What a try is judged to be."""

from bad_input_bench.attempts import Said
from bad_input_bench.cases import Case

CLEAR, ACCEPTED, TRACEBACK, UNCLEAR, HARM = "clear", "accepted", "traceback", "unclear", "harm"
VERDICTS = (CLEAR, ACCEPTED, UNCLEAR, TRACEBACK, HARM)

MOST_LINES = 4
MOST_LETTERS = 1200
SMALL_PRINT = ("Usage: ", "Try '")
"""Lines of click around a message."""


def judge(case: Case, said: Said, undisturbed: str | None) -> str:
    """One of ``VERDICTS``.

    Args:
        undisturbed: digest of what the same command makes with nothing broken.
    """
    if any(name.startswith("outside") for name in said.made):
        return HARM
    if said.status is None or "Traceback (most recent call last)" in said.text:
        return TRACEBACK
    if said.status == 0:
        right = case.undisturbed is None or (said.digest is not None and said.digest == undisturbed)
        return ACCEPTED if case.fine and right else HARM
    if said.made:
        return HARM  # something half made, or lost
    return CLEAR if _is_clear(case, message(said.text)) else UNCLEAR


def message(text: str) -> str:
    """The last message of a text, without progress before it and click's usage around it."""
    for marker in ("egosplat: ", "Error: "):
        before, found, after = text.rpartition(marker)
        if found and (not before or before.endswith("\n")):
            text = after
            break
    lines = (line for line in text.strip().splitlines() if not line.startswith(SMALL_PRINT))
    return "\n".join(lines)


def _is_clear(case: Case, text: str) -> bool:
    short = len(text.splitlines()) <= MOST_LINES and len(text) <= MOST_LETTERS
    return short and any(name in text for name in case.named)
