"""The survey's page has the verdicts of its rows."""

import pandas as pd

from benchmarks.survey.__main__ import ROWS, table


def test_the_page_has_the_table_of_its_rows_and_misses_no_people():
    rows = pd.read_csv(ROWS)
    assert table(rows) in ROWS.with_name("README.md").read_text()
    assert (
        rows["masked"][rows["moves"] == "people"].all()
        and not rows["masked"][rows["moves"] == "nothing"].any()
    )
