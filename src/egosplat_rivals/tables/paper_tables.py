"""Build the paper's five tables: printed numbers, and measured numbers below."""

from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, product
from string import ascii_lowercase

from egosplat.evaluation.intervals import clustered_interval, mean_of_scenes
from egosplat.evaluation.scores import CHANCE
from egosplat_rivals.compared import NAMES
from egosplat_rivals.scored_scenes import (
    APARTMENTS,
    FULL,
    OWN,
    PIXELS,
    VALIDATION,
    VALIDATION_APARTMENTS,
    Cell,
    ScoredScene,
    Series,
    percent_bounds,
)
from egosplat_rivals.tables.paper_numbers import LAYOUTS, find_notes, printed_numbers, scenes_of
from egosplat_rivals.tables.table import AVERAGE, PRINTED, REAL, SYNTHETIC, Layout, Note, Row, blocks

INTERVALS = (
    "Intervals are for other categories, and for averages also for other scenes. Categories are resampled, not queries, "
    "because the queries of one category show one thing in several frames. A score of a single category has no interval."
)
READOUTS = (
    "Rows asked by pixels blend codes, decode each pixel and cut masks at LangSplat's relative threshold; the others render "
    "relevancies of Gaussians, and a mask is what those above the threshold fill by half. Only EgoSplat has sizes. Compare rows asked alike."
)


def paper_tables(series: Sequence[Series]) -> list[Layout]:
    """Build all five tables, with a row for each series that belongs to one."""
    return [_fill(layout, series) for layout in LAYOUTS]


def _fill(layout: Layout, series: Sequence[Series]) -> Layout:
    own = [one for one in series if one.first.dataset == layout.dataset and _scenes_of(layout, one)]
    if layout.components:  # an ablation of EgoSplat
        own = [one for one in own if one.first.method is None]
    letters = chain(ascii_lowercase, map("".join, product(ascii_lowercase, repeat=2)))
    notes = [replace(one, mark=next(letters) if one.cells else "") for one in find_notes(layout.name)]
    measured = _measured_rows(layout, own)
    marks = {text: next(letters) for text in dict.fromkeys(one for row in measured for one in row.stands_in)}
    measured = [replace(row, mark=",".join(sorted(marks[one] for one in row.stands_in))) for row in measured]
    synthetic = f" The last rows are of {APARTMENTS}, not of {NAMES[layout.dataset]}."
    return replace(
        layout,
        caption=layout.caption + (synthetic if any(row.kind == SYNTHETIC for row in measured) else ""),
        rows=(*_printed_rows(layout, notes), *measured),
        notes=(
            *notes,
            *(Note(_sentence(text), mark=mark) for text, mark in marks.items()),
            *map(Note, _remarks(measured)),
            *map(Note, _presence_remarks(layout, own)),
        ),
    )


def _printed_rows(layout: Layout, notes: Sequence[Note]) -> Iterator[Row]:
    name = NAMES[layout.dataset]
    for line, (_, steps) in layout.lines.items():
        method = OWN if layout.components else line
        keys = [(scene, line, metric, group) for scene, metric, group in layout.columns]
        yield Row(
            PRINTED,
            f"Printed in the paper, on {name}",
            f"{method} (paper, {name})",
            method,
            name,
            steps,
            tuple(Cell(printed_numbers()[layout.name, *key]) for key in keys),
            checkpoints="the paper's",
            variant=line if steps else "",
            marks=tuple(next((note.mark for note in notes if key in note.cells), "") for key in keys),
        )


def _measured_rows(layout: Layout, series: Sequence[Series]) -> list[Row]:
    name = NAMES[layout.dataset]
    titles = {
        (REAL, False): f"Measured by egosplat on {name}",
        (SYNTHETIC, False): f"Measured on {APARTMENTS}: not {name}, not comparable with any row above",
        (SYNTHETIC, True): (
            f"Measured on {VALIDATION_APARTMENTS} ({VALIDATION[0]} to {VALIDATION[-1]}): "
            f"not {name}, not comparable with any row above"
        ),
    }
    rows: list[Row] = []
    for kind, title in titles.items():
        own = [one for one in series if (one.first.origin, one.first.validation) == kind]
        rows += _block(layout, title, own)
    return rows or [_empty_row(layout, REAL, titles[REAL, False], line, name) for line in layout.lines]


def _block(layout: Layout, title: str, series: Sequence[Series]) -> Iterator[Row]:
    """Rows of one block in the paper's order, empty without scores, methods that it lacks, then the chance level."""
    # EgoSplat's series belong to the line of their variant, others to that of their method.
    own: dict[str | None, list[Series]] = {}
    for one in series:
        own.setdefault(one.first.method or layout.variants.get(one.first.variant), []).append(one)
    own.pop(None, None)
    if not own:
        return
    for line in dict.fromkeys([*layout.lines, *filter(None, own)]):
        if line in own:
            _, steps = layout.lines.get(line, (None, ()))
            yield from (_row(layout, title, steps, one) for one in own[line])
        else:
            yield _empty_row(layout, series[0].first.origin, title, line, series[0].data)
    yield from _chance_rows(layout, title, series)


def _chance_rows(layout: Layout, title: str, series: Sequence[Series]) -> Iterator[Row]:
    """Rows with the accuracy of each of ``CHANCE`` on the scenes of a block."""
    if not any(metric == "accuracy" for _, metric, _ in layout.columns):
        return
    scenes = ChainMap(*(_scenes_of(layout, one) for one in series))
    kind, data, steps = series[0].first.origin, series[0].data, (False,) * len(layout.components)
    for answerer, name in CHANCE.items():
        cells = tuple(
            _cell(place, answerer, group, scenes) if metric == "accuracy" else Cell()
            for place, metric, group in layout.columns
        )
        yield Row(kind, title, f"Chance: {name} ({data})", name, data, steps, cells)


def _row(layout: Layout, title: str, steps: tuple[bool, ...], series: Series) -> Row:
    scenes = _scenes_of(layout, series)
    # EgoSplat's own sentences are on its geometry alone.
    documents = (scene.document for scene in scenes.values() if scene.method is not None)
    return Row(
        series.first.origin,
        title,
        series.label,
        series.method,
        series.data,
        steps,
        tuple(_cell(*column, scenes) for column in layout.columns),
        checkpoints=series.checkpoints,
        variant=series.first.variant,
        notice=series.notice,
        cost=_mean_cost(scenes.values()),
        stands_in=tuple(dict.fromkeys(text for one in documents for text in one.get("stands_in", ()))),
        readout=series.first.readout,
    )


def _mean_cost(scenes: Iterable[ScoredScene]) -> tuple[float, float] | None:
    """The mean of what the making of the codes took, from the frames on; None if an artifact is lost."""
    costs = []
    for scene in scenes:
        artifacts = scene.document["artifacts"]
        made = [entry for name, entry in artifacts.items() if name != "annotations.zarr"]
        if not made or None in made:
            return None
        memory_gib = max(entry["peak_memory_mb"] for entry in made) / 1024
        costs.append((sum(entry["cpu_s"] for entry in made) / 60, memory_gib))
    if not costs:
        return None
    cpu_min, memory_gib = (sum(values) / len(costs) for values in zip(*costs, strict=True))
    return cpu_min, memory_gib


def _cell(place: str, score: str, group: str, scenes: Mapping[str, ScoredScene]) -> Cell:
    """A metric or a chance level of a scene or on average."""
    if place == AVERAGE:
        return average(scenes, score, group)
    return scenes[place].cell(score, group) if place in scenes else Cell()


def _scenes_of(layout: Layout, series: Series) -> dict[str, ScoredScene]:
    """The scenes of a series that belong to a table."""
    names = scenes_of(layout, series.first.validation)
    return {name: series.scenes[name] for name in names if name in series.scenes}


def _empty_row(layout: Layout, kind: str, title: str, line: str, data: str) -> Row:
    variant, steps = layout.lines[line]
    method, by = (line, "") if variant is None else (OWN, "egosplat, ")
    label, cells = f"{method} ({by}{data}: not measured)", (Cell(),) * len(layout.columns)
    return Row(kind, title, label, method, data, steps, cells, variant=variant or "")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _remarks(rows: Sequence[Row]) -> Iterator[str]:
    """Notes on measured rows."""
    yield from map(_sentence, dict.fromkeys(row.notice for row in rows if row.notice))
    if any(cell.interval for row in rows for cell in row.cells):
        yield INTERVALS
    if any(row.readout == PIXELS for row in rows):
        yield READOUTS
    for _, own in blocks(rows):
        data = own[0].data
        if len({row.scenes for row in own if row.scenes}) > 1:
            yield f"Averages on {data} are over different scenes, and not comparable."
        if own[0].kind == REAL and any(cell.queries for row in own for cell in row.cells):
            yield f"Measured on {data} in egosplat's own evaluation frames; the paper's frames are not known."


def _presence_remarks(layout: Layout, series: Sequence[Series]) -> Iterator[str]:
    """Notes on the answers of each row to queries of present and absent things, in tables with accuracies."""
    if not any(metric == "accuracy" for _, metric, _ in layout.columns):
        return
    # What asks the codes of another variant by pixels asks the whole scene as it does.
    for one in (one for one in series if not one.first.variant.endswith(PIXELS)):
        if summary := _presence_summary(_scenes_of(layout, one).values()):
            variant = "" if one.first.variant == FULL else f", {one.first.variant}"
            yield f"{one.label}{variant}: {summary}."


def average(scenes: Mapping[str, ScoredScene], score: str, group: str) -> Cell:
    """The plain mean of a metric over the scenes that have a score, as in the paper's tables, with ``clustered_interval``.

    That of one of ``CHANCE`` has no interval.
    """
    scenes = dict(sorted(scenes.items()))
    if score in CHANCE:
        cells = {name: scene.cell(score, group).percent for name, scene in scenes.items()}
        known = {name: percent for name, percent in cells.items() if percent is not None}
        return Cell(sum(known.values()) / len(known), scenes=tuple(known)) if known else Cell()
    clusters = {name: scene.clusters(score, group) for name, scene in scenes.items()}
    scored = {name: values for name, values in clusters.items() if len(values.counts)}
    if not scored:
        return Cell()
    values = list(scored.values())
    return Cell(
        percent=100 * mean_of_scenes(values),
        interval=percent_bounds(clustered_interval(values)),
        queries=int(sum(scene.counts.sum() for scene in values)),
        categories=sum(len(scene.counts) for scene in values),
        scenes=tuple(scored),
    )


def _presence_summary(scenes: Iterable[ScoredScene]) -> str | None:
    """How often queries of whole scenes are answered; None without queries of absent things, as for other methods."""
    entries = [scene.document["presence"] for scene in scenes if "presence" in scene.document]

    def total(kind: str, key: str) -> int:
        return sum(entry[kind][key] for entry in entries)

    if not total("absent", "asked"):
        return None
    return (
        f"in queries of the whole scene, {total('present', 'answered')} of {total('present', 'asked')} present things "
        f"are found, {total('present', 'right')} of them correctly, and {total('absent', 'answered')} of "
        f"{total('absent', 'asked')} absent things; best guesses are right for {total('present', 'guessed_right')} more"
    )
