"""The committed pages of scores: what their intervals are of, and what is claimed."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCORES = ("ablation", "true_instances", "required", "tradeoff", "open_vocabulary")
INTERVAL = re.compile(r"\([+−-]?\d+\.\d to [+−-]?\d+\.\d\)")


@pytest.mark.parametrize("name", SCORES)
def test_a_page_with_intervals_says_what_they_are_over(name):
    """Over categories; or over queries, and then that they are too narrow."""
    text = (ROOT / "benchmarks" / name / "README.md").read_text(encoding="utf-8")
    assert INTERVAL.search(text)
    head = " ".join(text[: text.index("| --- |")].casefold().split())
    assert "intervals over queries, too narrow" in head or "intervals over categories" in head


@pytest.mark.parametrize("page", ["README.md", "benchmarks/README.md", "config/README.md"])
def test_an_overview_has_no_interval_over_queries_without_a_word(page):
    """Each section of an overview that has an interval says that it is over categories, or too narrow."""
    sections = re.split(r"^## ", (ROOT / page).read_text(encoding="utf-8"), flags=re.MULTILINE)
    bare = [section for section in sections if INTERVAL.search(section) and "too narrow" not in section]
    assert not [section for section in bare if "over categories" not in section]
