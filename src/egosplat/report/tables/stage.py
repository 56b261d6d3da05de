"""Stage ``tables``: write the paper's tables, with measured numbers below the printed ones."""

from collections.abc import Sequence
from pathlib import Path

from egosplat.evaluation.scored_scenes import ScoredScene, check_protocol, read_scored_scene
from egosplat.files import write_text
from egosplat.progress import log
from egosplat.report.tables.formats import to_csv, to_latex, to_markdown
from egosplat.report.tables.page import read_picture, to_html
from egosplat.report.tables.paper_layouts import in_a_table
from egosplat.report.tables.paper_tables import paper_tables
from egosplat.report.tables.series import find_series

PAGE = "tables.html"

_FORMATS = {"csv": to_csv, "md": to_markdown, "tex": to_latex}


def run(metrics: Sequence[Path], output: Path, *, pictures: Sequence[Path]) -> None:
    """Write each of ``egosplat.report.tables.paper_layouts.LAYOUTS`` as CSV, Markdown and LaTeX, and all on one HTML page.

    Files are written atomically; equal inputs give equal bytes.

    Args:
        metrics: ``metrics.json`` files of egosplat's variants and of other methods, see ``read_scored_scene``. Files that
            belong to no table are logged and left out.
        output: folder of the files, created if it does not exist.
        pictures: PNG or JPEG files of scenes, for the end of the page.

    Raises:
        UserError: a file cannot be read, two files are of the same scene, or protocols differ.
    """
    scenes = _with_a_place([read_scored_scene(path) for path in metrics])
    check_protocol(scenes)
    series = find_series(scenes)
    tables = paper_tables(series)
    confidence = next((scene.protocol["confidence"] for scene in scenes), None)
    page = to_html(tables, series, [read_picture(path) for path in pictures], confidence)
    for table in tables:
        for suffix, form in _FORMATS.items():
            write_text(output / f"{table.name}.{suffix}", form(table))
    write_text(output / PAGE, page)
    log(f"{len(scenes)} scored scenes in {len(tables)} tables: {output / PAGE}")


def _with_a_place(scenes: Sequence[ScoredScene]) -> list[ScoredScene]:
    for one in scenes:
        if not in_a_table(one):
            log(f"{one.path}: no table shows {one.dataset}/{one.scene}, variant {one.variant}")
    return [one for one in scenes if in_a_table(one)]
