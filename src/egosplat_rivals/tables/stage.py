"""Stage ``tables``: write the paper's tables, with measured numbers below the printed ones."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from egosplat.alarms.artifact_alarms import advice_of, found_text
from egosplat.alarms.table import TABLE, Alarm
from egosplat.evaluation.intervals import CONFIDENCE
from egosplat.files import write_text
from egosplat.progress import log
from egosplat.report.html_page import render_page
from egosplat_rivals.scored_scenes import ScoredScene, Series, check_protocol, find_series, read_scored_scene
from egosplat_rivals.tables.formats import COMMAND, to_csv, to_html
from egosplat_rivals.tables.page import TEMPLATE, Picture, Section, plain_table
from egosplat_rivals.tables.paper_numbers import in_a_table
from egosplat_rivals.tables.paper_tables import paper_tables
from egosplat_rivals.tables.table import Layout


def run(metrics: Sequence[Path], output: Path, *, pictures: Sequence[Path]) -> None:
    """Write each of ``egosplat_rivals.tables.paper_numbers.LAYOUTS`` as CSV, and all on one HTML page.

    ``metrics`` are ``metrics.json`` of variants and of other methods; those of no table are logged and left out. ``pictures``
    are PNG or JPEG files for the end of the page. Files are written atomically; equal inputs give equal bytes.

    Raises:
        UserError: a file cannot be read, two files are of the same scene, or protocols differ.
    """
    read = [read_scored_scene(path) for path in metrics]
    scenes = [one for one in read if in_a_table(one)]
    for one in read:
        if one not in scenes:
            log(f"{one.path}: no table shows {one.dataset}/{one.scene}, variant {one.variant}")
    check_protocol(scenes)
    series = find_series(scenes)
    tables = paper_tables(series)
    page, path = write_page(tables, series, pictures), output / "tables.html"
    for table in tables:
        write_text(output / f"{table.name}.csv", to_csv(table))
    write_text(path, page)
    log(f"{len(scenes)} scored scenes in {len(tables)} tables: {path}")


def write_page(tables: Sequence[Layout], series: Sequence[Series], pictures: Sequence[Path]) -> str:
    """Write all tables, the measured scenes, their alarms and pictures as one page."""
    scenes = [(one, scene) for one in series for scene in one.scenes.values()]
    measured_on = "; ".join(sorted({one.about for one in series}))
    sections = [
        Section(table.name, table.caption, table=to_html(table), notes=[*map(str, table.notes)])
        for table in tables
    ]
    if scenes:
        sources = plain_table([_source(*one) for one in scenes])
        sections.append(Section("sources", "Measured scenes", table=sources, style="words"))
    if alarms := [line for _, scene in scenes for line in _alarms(scene)]:
        about = "Values found by the stages that make a scene's scores unreliable."
        sections.append(Section("alarms", "Alarms", about, plain_table(alarms), "words"))
    sections.append(Section("pictures", pictures=[*map(Picture, pictures)]))
    return render_page(
        *TEMPLATE,
        generator=COMMAND,
        title=f"EgoSplat's tables{f': measured on {measured_on}' if measured_on else ''}",
        heading="EgoSplat's tables",
        intro=_intro(measured_on),
        warnings=(),
        sections=sections,
    )


def _intro(measured_on: str) -> Iterator[str]:
    yield f"Numbers printed in the paper, and numbers measured by egosplat on {measured_on or 'nothing (none yet)'}."
    yield (
        "Compare rows only within a block. Scores on synthetic apartments have a yellow background and are not ranked. In the "
        "other blocks, the best number of rows asked alike is red and the second best is teal."
    )
    if measured_on:
        yield (
            f"Below a measured number is its {100 * CONFIDENCE:g} % interval; the last rows of a block are the chance level."
        )
    yield "The cost of a measured row is what a scene takes from its frames to its codes, with all that its variants share."


def _source(series: Series, scene: ScoredScene) -> dict[str, str | int]:
    return {
        "Row": series.label,
        "Scene": f"{scene.dataset}/{scene.scene}",
        "Variant": scene.variant,
        "Origin": scene.origin,
        "Queries": scene.document["scores"]["all"]["count"],
        "Models": ", ".join(scene.models) or "unknown",
        "Scored": scene.document["provenance"]["created"],
        "File": str(scene.path),
    }


def _alarms(scene: ScoredScene) -> Iterator[dict[str, str]]:
    for alarm in (Alarm(**entry) for entry in scene.document["alarms"]):
        yield {
            "Scene": f"{scene.dataset}/{scene.scene}",
            "Variant": scene.variant,
            "Alarm": alarm.key,
            "Found": found_text(alarm),
            "Normal": TABLE[alarm.key].normal,
            "What to do": advice_of(alarm),
        }
