"""The table in docs/numerics.md is of the cases that there are."""

from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
TABLE = HERE.parent.parent / "docs/numerics.md"
LEAST = 60


def test_the_table_has_every_case(request: pytest.FixtureRequest) -> None:
    if request.config.getoption("--numerics-table", default=None):
        pytest.skip("the table is being written")
    items = [item for item in request.session.items if item.path.is_relative_to(HERE)]
    cases = {mark.args[0] for item in items for mark in item.iter_markers("numerics")}
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    rows = {line.split("|")[1] for line in lines if line.startswith("|")} - {"input", "---"}
    assert not cases - rows, "make numerics"
    if {item.path for item in items} == set(HERE.rglob("test_*.py")):
        assert cases == rows and len(rows) >= LEAST, "make numerics"
