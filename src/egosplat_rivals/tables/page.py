"""Parts of a page of tables and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from egosplat.report.html_page import read_picture

# The package and the name of the template of all pages here.
TEMPLATE = "egosplat_rivals.tables", "page.html.j2"


class Picture:
    """An image file on a page: its content as a data URI, its path below ``results``, and its caption. Raises as ``read_picture``."""

    def __init__(self, path: Path, about: str | None = None) -> None:
        self.address, self.name = read_picture(path), path.as_posix().rpartition("results/")[2]
        self.about = self.name if about is None else about


@dataclass(frozen=True)
class Section:
    """A part of a page: the HTML of a table, with escaped texts, between a lead and notes; then pictures.

    ``style`` are classes of the table: ``words`` (texts to be wrapped), ``named`` (a name in the first column), ``synthetic``
    (numbers of synthetic apartments).
    """

    id: str
    heading: str = ""
    lead: str = ""
    table: str = ""
    style: str = ""
    notes: Sequence[str] = ()
    pictures: Sequence[Picture] = ()


def plain_table(records: Sequence[Mapping[str, Any]]) -> str:
    """A table element with a column for each key, a text or two headings; every text is escaped."""
    frame = pd.DataFrame(records)
    if isinstance(frame.columns[0], tuple):
        frame.columns = pd.MultiIndex.from_tuples(frame.columns)
    # Without formatters, line breaks would be written as backslash and n.
    return frame.to_html(index=False, border=0, formatters=[str] * frame.shape[1])
