"""Findings of the doctor, and the page that lists them in aligned plain text."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from textwrap import TextWrapper

# Width of the page [characters]. Paths and addresses are not broken.
WIDTH = 110


class Mark(StrEnum):
    """Whether the configuration can run with what was found."""

    OK = "ok"
    NOTE = "note"
    MISSING = "missing"


@dataclass(frozen=True)
class Finding:
    """One entry of the page.

    Attributes:
        mark: ``missing`` if the configuration needs something that is absent.
        advice: what to do; empty if nothing.
    """

    mark: Mark
    what: str
    value: str
    advice: str = ""


def page(findings: Sequence[Finding]) -> str:
    """The findings as aligned lines, followed by the number of missing things."""
    what = max(len(finding.what) for finding in findings)
    mark = max(len(mark) for mark in Mark)
    lines = [line for finding in findings for line in _lines(finding, mark, what)]
    missing = sum(finding.mark == Mark.MISSING for finding in findings)
    things = "1 thing" if missing == 1 else f"{missing} things"
    verdict = f"{things} that this configuration needs: see 'missing'" if missing else "Nothing is missing."
    return "\n".join([*lines, "", verdict])


def _lines(finding: Finding, mark: int, what: int) -> list[str]:
    head = f"{finding.mark:{mark}}  {finding.what:{what}}  "
    wrapper = TextWrapper(WIDTH - len(head), break_long_words=False, break_on_hyphens=False)
    paragraphs = [finding.value, *finding.advice.splitlines()]
    wrapped = [line for text in paragraphs for line in wrapper.wrap(text) or [""]]
    return [head + wrapped[0], *(" " * len(head) + line for line in wrapped[1:])]
