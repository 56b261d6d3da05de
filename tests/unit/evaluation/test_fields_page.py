"""docs/metrics.md names and describes each field of metrics.json."""

import re
from pathlib import Path

from egosplat.evaluation.fields_page import fields_page

PAGE = Path(__file__).resolve().parents[3] / "docs" / "metrics.md"


def test_the_page_is_that_of_the_schema():
    """After a change of the schema: python -m egosplat.evaluation.fields_page > docs/metrics.md."""
    assert PAGE.read_text() == fields_page()


def test_every_field_is_described():
    rows = re.findall(r"^\| `(.+?)` \| .+? \|(.*)\|$", fields_page(), re.MULTILINE)
    assert {"recording.hash", "queries[].groups.all", "total.wall_s", "hit", "psnr"} <= {
        name for name, _ in rows
    }
    assert [name for name, about in rows if not about.strip()] == []
