"""A figure on a page is that of committed rows, or stands in a dated block; nobody edits it by hand."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import figures, quotes, rows
from benchmarks.common import ROOT
from egosplat.errors import UserError
from egosplat.evaluation.intervals import cluster, clustered_interval
from tests.support.rows import SCENES, some_rows


@pytest.fixture
def source(tmp_path, monkeypatch):
    """Rows of a topic ``mine``, written and read again."""
    monkeypatch.setattr(rows, "LEDGER", tmp_path)
    rows.write_rows(tmp_path / "mine", some_rows())
    yield rows.read_rows(tmp_path / "mine")
    for cached in (quotes._rows, quotes._filled):
        cached.cache_clear()


def faults_of(folder: Path, name: str, text: str) -> list[str]:
    """What is wrong with a page of a name."""
    page = folder / name
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text)
    return list(quotes.faults(page, folder))


def test_every_figure_of_the_pages_is_quoted_or_dated():
    """After a change: python -m benchmarks.quotes, which names the command."""
    assert [fault for page in quotes.pages() for fault in quotes.faults(page)] == []


HEADLINE = r"<!--= \S+ accuracy full -->.*?<!--/-->"
TRICKS = [
    ("README.md", HEADLINE, "94 %"),
    ("README.md", HEADLINE, "ninety-four percent"),
    ("README.md", HEADLINE, ""),
    ("README.md", r"(accuracy full -->)\d+", r"\g<1>94"),
    ("README.md", r"(accuracy full -->)(\d+ %)(.*?<!--/-->)", r"\1\3 \2"),
    ("README.md", r"<!--= \S+ (accuracy full) -->", r"<!--= 0.2.0-names \1 -->"),
    ("README.md", r"(= \S+ accuracy) draft", r"\1 full"),
    ("README.md", r"!\[", "![94 % are found: "),
    ("README.md", r"## Ask\n", "## Ask\n\nOf 75 places, 36 are told rightly.\n"),
    ("README.md", r"(carried objects, <!--= \S+ places right -->)\d+", r"\g<1>36"),
    ("benchmarks/README.md", r"(= \S+ accuracy) draft", r"\1 full"),
    ("benchmarks/README.md", r"best of three masks 0", "best of three masks 1"),
    ("benchmarks/presence/README.md", r"(\| 70 % \| the reader's \| )\d+", r"\g<1>88"),
    ("benchmarks/presence/README.md", r"(?s)<!--= presence fit -->(.*?)<!--/-->", r"\1"),
    ("benchmarks/methods/README.md", r"(they found )\d", r"\g<1>9"),
    ("benchmarks/colmap/README.md", r"<!--~\d{4}", "<!--~2027"),
    ("benchmarks/colmap/README.md", r"<!--~(\S{11})\w{8}", r"<!--~\g<1>d68c81e0"),
    ("benchmarks/colmap/README.md", r"(?s)\w{8}-->(.*)120", r"01234567-->\g<1>119"),
    ("benchmarks/colmap/README.md", r"(?s)<!--~\S+-->(.*)<!--/~-->", r"\1"),
    ("benchmarks/colmap/README.md", r"<!--/~-->", ""),
    ("docs/speed.md", r"(?s)<!--~\S+-->(.*?)<!--/~-->", r"\1"),
]


@pytest.mark.parametrize("written", [False, True], ids=["by hand", "then --write"])
@pytest.mark.parametrize(("name", "old", "new"), TRICKS)
def test_a_page_cannot_be_edited_to_a_better_figure(tmp_path, name, old, new, written):
    page = (ROOT / name).read_text()
    edited, count = re.subn(old, new, page, count=1)
    assert count and edited != page, "the page has other figures now: edit one of them"
    edited = quotes.quoted(edited) if written else edited
    assert (faults_of(tmp_path, name, edited) != []) == (edited != page)


@pytest.mark.parametrize(
    ("new", "fault"),
    [("", "accuracy full: is not quoted"), ("<!--= 0.2.0-names accuracy full --><!--/-->", "full: quote ")],
)
def test_a_headline_that_is_dated_anew_has_all_quotes_of_one_source(tmp_path, monkeypatch, new, fault):
    monkeypatch.setattr(quotes, "history", lambda: {"c0dec0de": "2026-01-02"})
    page = re.sub(HEADLINE, new, (ROOT / "README.md").read_text())
    again = quotes.dated(quotes.quoted(page), "c0dec0de")
    assert any(fault in one for one in faults_of(tmp_path, "README.md", again))


@pytest.mark.parametrize(
    "text",
    [
        *("94 %", "36", "0.62", "4 of 5", "16 told rightly", "| 77 % (68 to 85) |", "49 s", "`94 %`"),
        *("forty-one percent", "two points", "94 %<!--/-->", "<!--~-->94 %", "![94 % found](a.png)"),
    ],
)
def test_a_page_of_measurements_has_no_bare_figure(tmp_path, text):
    (fault, *_) = faults_of(tmp_path, "benchmarks/new/README.md", f"# A page\n\nA {text}\n")
    assert fault.startswith("benchmarks/new/README.md: 'A ")


def test_names_code_and_links_are_no_figures(tmp_path):
    text = "3D, SAM2.1, scene1, Apache-2.0, Python 3.11 or 3.12, 95 % intervals, `0.2.0a`, [a](b/1.png)"
    assert faults_of(tmp_path, "benchmarks/new/README.md", f"{text}\n```sh\nmake 4\n```\n") == []


@pytest.mark.parametrize(
    "text",
    [
        *("77 % (68 to 85)", "0.45 (0.38 to 0.52)", "-6.1 (-1.4 to +14.3), p = 0.2", "6.1 points", "28.4 dB"),
        *("a mIoU of 0.47", "it finds 71 % of the queries", "71 % found", "71% of queries", "71 of 92"),
    ],
)
def test_another_page_has_no_bare_score(tmp_path, text):
    assert faults_of(tmp_path, "docs/new.md", "A threshold of 0.5 in 8 % of 512 px.\n") == []
    (fault,) = faults_of(tmp_path, "docs/new.md", f"# A page\n\n{text}\n")
    assert "a figure without rows or date" in fault


def test_a_block_is_dated_by_command_and_of_a_commit_of_this_history(tmp_path, monkeypatch):
    monkeypatch.setattr(quotes, "history", lambda: {"c0dec0de": "2026-01-02"})
    new = "<!--~-->It takes\n49 s.<!--/~-->\n"
    assert "--date COMMIT docs/new.md" in faults_of(tmp_path, "docs/new.md", new)[0]
    page = quotes.dated(new, "c0dec0de" * 5)
    assert page.startswith("<!--~2026-01-02.c0dec0de.") and faults_of(tmp_path, "docs/new.md", page) == []
    assert faults_of(tmp_path, "docs/new.md", page.replace("\n", " ")) == []
    changed = page.replace("49", "48")
    assert "--date c0dec0de docs/new.md" in faults_of(tmp_path, "docs/new.md", changed)[0]
    assert quotes.quoted(changed) == changed
    for known in ({"c0dec0de": "2026-01-03"}, {"cafecafe": "2026-01-03"}):
        monkeypatch.setattr(quotes, "history", lambda known=known: known)
        assert "no such commit" in faults_of(tmp_path, "docs/new.md", page)[0]
    assert quotes.dated(page, "cafecafe") == page
    assert quotes.dated(changed, "cafecafe").startswith("<!--~2026-01-03.cafecafe.")
    with pytest.raises(UserError, match="d68c81e0"):
        quotes.dated(changed, "d68c81e0")
    monkeypatch.setattr(quotes, "history", lambda: None)
    assert faults_of(tmp_path, "docs/new.md", page) == []


@pytest.mark.parametrize(
    "words",
    [
        *("accuracy full", "accuracy full static", "mean_iou other", "psnr full static", "minutes full"),
        *("accuracy_difference full other", "mean_iou_difference full other", "chance full random_pixel"),
        *("presence full right", "presence full absent", "presence full guessed", "queries full"),
        *("presence full asked", "presence full refused", "places all", "places right", "places wrong"),
        *("scores", "scores busy", "differences", "blind", "fit"),
    ],
)
def test_figures_are_written_and_a_changed_one_is_a_fault(source, tmp_path, words):
    blank = f"| a | <!--= mine {words} --><!--/--> |"
    assert faults_of(tmp_path, "PAGE.md", blank)
    right = quotes.quoted(blank)
    assert faults_of(tmp_path, "PAGE.md", right) == [] and quotes.quoted(right) == right
    told = quotes.QUOTE.search(right)["told"]
    changed = told.replace(*next((d, str(9 - int(d))) for d in told if d.isdigit()), 1)
    (fault,) = faults_of(tmp_path, "PAGE.md", right.replace(told, changed))
    assert fault.startswith(f"PAGE.md: mine {words}: ")


@pytest.mark.parametrize(
    "words",
    [
        *("mine speed full", "mine accuracy", "mine accuracy none", "mine queries full some", "other fit"),
        *("mine places found", "mine scores foreign"),
    ],
)
def test_a_quote_of_nothing_is_a_fault(source, tmp_path, words):
    (fault,) = faults_of(tmp_path, "PAGE.md", f"<!--= {words} -->50 %<!--/-->")
    assert fault.startswith(f"PAGE.md: {words}: ")


def test_an_interval_is_that_of_the_rows_by_hand(source):
    """From the committed table to the printed bounds, with nothing but the documented bootstrap."""
    table = source.tables["queries"]
    clusters = []
    for scene in SCENES:
        own = [
            row for row in table.itertuples() if (row.scene, row.setting, row.group) == (scene, "full", "all")
        ]
        clusters.append(cluster([row.hit for row in own], [row.category for row in own]))
    bounds = clustered_interval(clusters)
    mean = np.mean([one.totals.sum() / one.counts.sum() for one in clusters])
    expected = f"{100 * mean:.0f} % ({100 * bounds[0]:.0f} to {100 * bounds[1]:.0f})"
    assert figures.compute(source, ["accuracy", "full"]) == expected


def test_what_is_refused_without_asking_is_no_absent_thing_that_was_not_found(source):
    words = ("asked", "refused", "absent")
    asked, refused, found = (figures.compute(source, ["presence", "full", what]) for what in words)
    table = source.of("presence", "full", present=0, untaught=0)
    assert (asked, refused) == ("4", "4") and found.startswith(f"{100 * table['answered'].mean():.0f} % ")
    counts = [figures.compute(source, ["places", what]) for what in ("all", "right", "wrong")]
    assert counts == ["3", "1", "1"]


def test_rows_are_never_replaced_and_a_changed_table_is_named(source, tmp_path):
    with pytest.raises(UserError, match="mine: is there"):
        rows.write_rows(tmp_path / "mine", some_rows())
    path = tmp_path / "mine" / "queries.csv.xz"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(UserError, match="queries.csv.xz: is not the table that was written"):
        rows.read_rows(tmp_path / "mine")


@pytest.mark.skipif(quotes.history() is None, reason="needs the whole history")
def test_tables_of_the_ledger_are_only_added():
    """A table and its digest could be changed together."""
    tables = ("--", "benchmarks/ledger/*/*.csv.xz")
    assert quotes.git("log", "--diff-filter=MDR", "--format=%h", *tables) == ""
    assert quotes.git("diff", "--diff-filter=MDR", "--name-only", "HEAD", *tables) == ""


def test_a_paired_difference_is_over_the_same_queries(source):
    """A query that only one of two settings has counts for neither."""
    paired = figures.pair(source, "full", "other", "hit")
    assert (
        len(paired)
        == len(source.of("queries", "other", group="all"))
        < len(source.of("queries", "full", group="all"))
    )
