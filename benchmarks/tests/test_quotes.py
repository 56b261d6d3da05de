"""A score on a page is that of committed rows, or listed as one to be made anew."""

import re

import numpy as np
import pytest

from benchmarks import figures, quotes, rows
from benchmarks.common import ROOT
from egosplat.errors import UserError
from egosplat.evaluation.intervals import RESAMPLING, cluster, clustered_interval
from tests.support.rows import SCENES, some_rows


@pytest.fixture
def source(tmp_path, monkeypatch):
    """Rows of a topic ``mine``, written and read again."""
    monkeypatch.setattr(rows, "LEDGER", tmp_path)
    quotes._rows.cache_clear()
    rows.write_rows(tmp_path / "mine", some_rows())
    yield rows.read_rows(tmp_path / "mine")
    quotes._rows.cache_clear()


def on_page(tmp_path, text: str) -> list[str]:
    """What is wrong with a page."""
    page = tmp_path / "PAGE.md"
    page.write_text(text)
    return list(quotes.faults(page, tmp_path))


def test_the_pages_of_the_repository_quote_their_rows():
    """After a change: python -m benchmarks.quotes --write; a new score needs rows."""
    assert [fault for page in quotes.pages() for fault in quotes.faults(page)] == []


def test_every_page_to_be_made_anew_is_there_and_has_as_many_scores():
    """What is made anew leaves the list."""
    found = {name: len(quotes.unquoted((ROOT / name).read_text())) for name in quotes.TO_BE_MADE_ANEW}
    assert found == quotes.TO_BE_MADE_ANEW


@pytest.mark.parametrize(
    "words",
    [
        "accuracy full",
        "accuracy full static",
        "mean_iou other",
        "accuracy_difference full other",
        "mean_iou_difference full other",
        "psnr full static",
        "presence full right",
        "presence full absent",
        "presence full guessed",
        "chance full random_pixel",
        "minutes full",
        "queries full",
        "scores",
        "differences",
        "blind",
    ],
)
def test_figures_are_written_and_a_changed_one_is_a_fault(source, tmp_path, words):
    blank = f"| a | <!--= mine {words} --><!--/--> |"
    assert on_page(tmp_path, blank)
    right = quotes.quoted(blank)
    assert on_page(tmp_path, right) == [] and quotes.quoted(right) == right
    told = quotes.QUOTE.search(right)["told"]
    changed = told.replace(*next((d, str(9 - int(d))) for d in told if d.isdigit()), 1)
    (fault,) = on_page(tmp_path, right.replace(told, changed))
    assert fault.startswith(f"PAGE.md: mine {words}: ")


@pytest.mark.parametrize(
    "words",
    [
        "mine speed full",
        "mine accuracy",
        "mine accuracy none",
        "mine accuracy full some",
        "other accuracy full",
    ],
)
def test_a_quote_of_nothing_is_a_fault(source, tmp_path, words):
    (fault,) = on_page(tmp_path, f"<!--= {words} -->50 %<!--/-->")
    assert fault.startswith(f"PAGE.md: {words}: ")


@pytest.mark.parametrize(
    "text",
    [
        "found: 77 % (68 to 85)",
        "0.45 (0.38 to 0.52)",
        "-6.1 (-1.4 to +14.3), p = 0.2",
        "6.1 points fewer (-1.4 to 14.3, over categories)",
        "28.4 dB (27.0 to 29.1)",
        "a mIoU of 0.47",
        "it finds 71 % of the queries",
        "71 % found",
    ],
)
def test_a_score_without_rows_is_a_fault(tmp_path, text):
    (fault,) = on_page(tmp_path, f"# A page\n\n{text}\n")
    assert fault.startswith("PAGE.md: 1 lines have scores without rows")


def test_an_interval_is_that_of_the_rows_by_hand(source):
    """From the committed table to the printed bounds, with nothing but the documented bootstrap."""
    table = source.tables["queries"]
    clusters = []
    for scene in SCENES:
        own = [
            row for row in table.itertuples() if (row.scene, row.setting, row.group) == (scene, "full", "all")
        ]
        clusters.append(cluster([row.hit for row in own], [row.category for row in own]))
    bounds = clustered_interval(clusters, RESAMPLING)
    mean = np.mean([one.totals.sum() / one.counts.sum() for one in clusters])
    expected = f"{100 * mean:.0f} % ({100 * bounds.low:.0f} to {100 * bounds.high:.0f})"
    assert figures.compute(source, ["accuracy", "full"]) == expected
    assert re.fullmatch(r"\d+ % \(\d+ to \d+\)", expected)


def test_rows_are_never_replaced_and_a_changed_table_is_named(source, tmp_path):
    with pytest.raises(UserError, match="mine: is there"):
        rows.write_rows(tmp_path / "mine", some_rows())
    path = tmp_path / "mine" / "queries.csv.xz"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(UserError, match="queries.csv.xz: is not the table that was written"):
        rows.read_rows(tmp_path / "mine")


def test_a_paired_difference_is_over_the_same_queries(source):
    """A query that only one of two settings has counts for neither."""
    paired = figures.pair(source, "full", "other", "hit")
    assert (
        len(paired)
        == len(source.of("queries", "other", group="all"))
        < len(source.of("queries", "full", group="all"))
    )
