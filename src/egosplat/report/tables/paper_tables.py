"""Build the paper's five tables: printed numbers, and measured numbers below."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count, islice, product
from string import ascii_lowercase

from egosplat.evaluation.intervals import RESAMPLING, clustered_interval, mean_of_scenes, scaled
from egosplat.evaluation.scored_scenes import CHANCE, FULL, UNTOUCHED, ScoredScene
from egosplat.report.tables.paper_layouts import LAYOUTS, Layout, Line
from egosplat.report.tables.paper_numbers import AVERAGE, PAPER_NOTES, printed
from egosplat.report.tables.series import APARTMENTS, NAMES, OWN, UNTOUCHED_APARTMENTS, Series
from egosplat.report.tables.table import (
    PRINTED,
    REAL,
    SYNTHETIC,
    Block,
    Cell,
    Column,
    Cost,
    Note,
    Row,
    Table,
    ranked,
)

INTERVALS = (
    "Intervals are for other categories, and for averages also for other scenes. Categories are resampled, not queries, "
    "because the queries of one category show one thing in several frames. A score of a single category has no interval."
)


def paper_tables(series: Sequence[Series]) -> list[Table]:
    """Build all five tables, with a row for each series that belongs to one."""
    return [_table(layout, series) for layout in LAYOUTS]


def _table(layout: Layout, series: Sequence[Series]) -> Table:
    own = [one for one in series if one.dataset == layout.dataset and _scenes_of(layout, one)]
    if layout.components:  # an ablation of EgoSplat
        own = [one for one in own if one.own]
    on_the_paper = _notes_on_the_paper(layout)
    measured, footnotes = _with_footnotes(
        _measured_blocks(layout, own), sum(bool(one.mark) for one in on_the_paper)
    )
    synthetic = f" The last rows are of {APARTMENTS}, not of {NAMES[layout.dataset]}."
    return Table(
        name=layout.name,
        caption=layout.caption + (synthetic if any(block.kind == SYNTHETIC for block in measured) else ""),
        components=layout.components,
        columns=layout.columns,
        blocks=(_printed_block(layout), *measured),
        notes=(*on_the_paper, *footnotes, *_notes_on(measured), *_presence_notes(layout, own)),
        scenes=layout.scenes,
    )


def _printed_block(layout: Layout) -> Block:
    name = NAMES[layout.dataset]
    rows = []
    for line in layout.lines:
        method = OWN if layout.components else line.printed
        cells = tuple(_printed_cell(layout, line, column) for column in layout.columns)
        label, variant = f"{method} (paper, {name})", line.printed if line.steps else ""
        rows.append(Row(label, method, name, "the paper's", variant, line.steps, cells))
    return Block(PRINTED, f"Printed in the paper, on {name}", ranked(rows))


def _printed_cell(layout: Layout, line: Line, column: Column) -> Cell:
    key = (column.scene, line.printed, column.metric, column.group)
    notes = zip(PAPER_NOTES[layout.name], _notes_on_the_paper(layout), strict=True)
    mark = next((note.mark for remark, note in notes if key in remark.cells), "")
    return Cell(percent=printed(layout.numbers, *key), mark=mark)


def _notes_on_the_paper(layout: Layout) -> list[Note]:
    """Notes on a table's printed numbers; notes on single cells have a letter."""
    letters = _letters()
    return [Note(next(letters) if one.cells else "", one.text) for one in PAPER_NOTES[layout.name]]


def _measured_blocks(layout: Layout, series: Sequence[Series]) -> list[Block]:
    name = NAMES[layout.dataset]
    titles = {
        (REAL, False): f"Measured by egosplat on {name}",
        (SYNTHETIC, False): f"Measured on {APARTMENTS}: not {name}, not comparable with any row above",
        (SYNTHETIC, True): (
            f"Measured on {UNTOUCHED_APARTMENTS} ({UNTOUCHED[0]} to {UNTOUCHED[-1]}), used for no choice of settings: "
            f"not {name}, not comparable with any row above"
        ),
    }
    rows = {
        kind: _rows(layout, [one for one in series if (one.origin, one.untouched) == kind]) for kind in titles
    }
    if not any(rows.values()):
        rows[REAL, False] = [_empty_row(layout, line, name) for line in layout.lines]
    return [Block(kind[0], titles[kind], own) for kind, own in rows.items() if own]


def _rows(layout: Layout, series: Sequence[Series]) -> tuple[Row, ...]:
    """Rows of one block in the paper's order, methods that it lacks, then the chance level.

    A line without scores gets an empty row.
    """
    known = {line: [one for one in series if _belongs(one, line)] for line in layout.lines}
    more = [
        one for one in series if not one.own and one.method not in {line.printed for line in layout.lines}
    ]
    if not more and not any(known.values()):
        return ()
    rows: list[Row] = []
    for line, own in known.items():
        rows += [_row(layout, line.steps, one) for one in own] or [_empty_row(layout, line, series[0].data)]
    rows += [_row(layout, (), one) for one in more]
    # A mark on the best synthetic row could be mistaken for the best row of the table.
    own = tuple(rows) if series[0].origin == SYNTHETIC else ranked(rows)
    return (*own, *_chance_rows(layout, series))


def _chance_rows(layout: Layout, series: Sequence[Series]) -> Iterator[Row]:
    """Rows with the accuracy of each of ``CHANCE`` on the scenes of a block."""
    if not any(column.metric == "accuracy" for column in layout.columns):
        return
    scenes: dict[str, ScoredScene] = {}
    for one in series:
        scenes = _scenes_of(layout, one) | scenes
    for answerer, name in CHANCE.items():
        label, steps = f"Chance: {name} ({series[0].data})", (False,) * len(layout.components)
        cells = tuple(_chance_cell(column, scenes, answerer) for column in layout.columns)
        yield Row(label, name, series[0].data, "", "", steps, cells)


def _chance_cell(column: Column, scenes: Mapping[str, ScoredScene], answerer: str) -> Cell:
    if column.metric != "accuracy":
        return Cell()
    if column.scene == AVERAGE:
        return average_chance(scenes, answerer, column.group)
    scene = scenes.get(column.scene)
    return scene.chance(answerer, column.group) if scene else Cell()


def _belongs(series: Series, line: Line) -> bool:
    """Whether a series belongs to a line: EgoSplat's by its variant, another method's by its name."""
    return series.variant == line.variant if series.own else series.method == line.printed


def _row(layout: Layout, steps: tuple[bool, ...], series: Series) -> Row:
    scenes = _scenes_of(layout, series)
    cells = tuple(_cell(column, scenes) for column in layout.columns)
    return Row(
        label=series.label,
        method=series.method,
        data=series.data,
        checkpoints=series.checkpoints,
        variant=series.variant,
        steps=steps,
        cells=cells,
        notice=series.notice or "",
        cost=_mean_cost([scene.cost for scene in scenes.values()]),
        stands_in=tuple(dict.fromkeys(text for scene in scenes.values() for text in scene.stands_in)),
    )


def _mean_cost(costs: Sequence[Cost | None]) -> Cost | None:
    """The mean of the costs of scenes; None if one is not known."""
    known = [cost for cost in costs if cost is not None]
    if not known or len(known) < len(costs):
        return None
    return Cost(
        sum(cost.cpu_min for cost in known) / len(known), sum(cost.memory_gib for cost in known) / len(known)
    )


def _cell(column: Column, scenes: Mapping[str, ScoredScene]) -> Cell:
    if column.scene == AVERAGE:
        return average(scenes, column.metric, column.group)
    scene = scenes.get(column.scene)
    return scene.cell(column.metric, column.group) if scene else Cell()


def _scenes_of(layout: Layout, series: Series) -> dict[str, ScoredScene]:
    """The scenes of a series that belong to a table."""
    names = layout.scenes_of(series.untouched)
    return {name: series.scenes[name] for name in names if name in series.scenes}


def _empty_row(layout: Layout, line: Line, data: str) -> Row:
    cells = tuple(Cell() for _ in layout.columns)
    if line.variant is None:
        return Row(f"{line.printed} ({data}: not measured)", line.printed, data, "", "", line.steps, cells)
    label = f"{OWN} (egosplat, {data}: not measured)"
    return Row(label, OWN, data, "", line.variant, line.steps, cells)


def _with_footnotes(blocks: Sequence[Block], taken: int) -> tuple[list[Block], list[Note]]:
    """Give each sentence of the rows a letter, after the first ``taken`` ones, and the rows their letters."""
    texts = dict.fromkeys(text for block in blocks for row in block.rows for text in row.stands_in)
    marks = dict(zip(texts, islice(_letters(), taken, None), strict=False))
    marked = [
        replace(
            block,
            rows=tuple(
                replace(row, mark=",".join(sorted(marks[text] for text in row.stands_in)))
                for row in block.rows
            ),
        )
        for block in blocks
    ]
    return marked, [Note(mark, f"{text[0].upper()}{text[1:]}.") for text, mark in marks.items()]


def _letters() -> Iterator[str]:
    """a to z, then aa, ab and so on."""
    for length in count(1):
        yield from map("".join, product(ascii_lowercase, repeat=length))


def _notes_on(blocks: Sequence[Block]) -> Iterator[Note]:
    """Notes on measured blocks."""
    notices = dict.fromkeys(row.notice for block in blocks for row in block.rows if row.notice)
    yield from (Note("", f"{notice[0].upper()}{notice[1:]}.") for notice in notices)
    if any(cell.interval for block in blocks for row in block.rows for cell in row.cells):
        yield Note("", INTERVALS)
    for block in blocks:
        data = block.rows[0].data
        if len({row.scenes for row in block.rows if row.scenes}) > 1:
            yield Note("", f"Averages on {data} are over different scenes, and not comparable.")
        if block.kind == REAL and any(cell.queries for row in block.rows for cell in row.cells):
            yield Note(
                "",
                f"Measured on {data} in egosplat's own evaluation frames; the paper's frames are not known.",
            )


def _presence_notes(layout: Layout, series: Sequence[Series]) -> Iterator[Note]:
    """Notes on the answers of each row to queries of present and absent things, in tables with accuracies."""
    if not any(column.metric == "accuracy" for column in layout.columns):
        return
    for one in series:
        if summary := _presence_summary(_scenes_of(layout, one).values()):
            variant = "" if one.variant == FULL else f", {one.variant}"
            yield Note("", f"{one.label}{variant}: {summary}.")


def average(scenes: Mapping[str, ScoredScene], metric: str, group: str) -> Cell:
    """The plain mean over the scenes that have a score, as in the paper's tables, with ``clustered_interval``.

    Args:
        scenes: scenes by name, scored with one confidence (see ``check_protocol``).
        metric: ``accuracy`` or ``mean_iou``.
        group: one of ``egosplat.evaluation.queries.GROUPS``.
    """
    clusters = {name: scene.clusters(metric, group) for name, scene in sorted(scenes.items())}
    scored = {name: values for name, values in clusters.items() if len(values.counts)}
    if not scored:
        return Cell()
    options = replace(RESAMPLING, confidence=scenes[next(iter(scored))].protocol["confidence"])
    values = list(scored.values())
    return Cell(
        percent=100 * mean_of_scenes(values),
        interval=scaled(clustered_interval(values, options), 100),
        queries=int(sum(scene.counts.sum() for scene in values)),
        categories=sum(len(scene.counts) for scene in values),
        scenes=tuple(scored),
    )


def average_chance(scenes: Mapping[str, ScoredScene], answerer: str, group: str) -> Cell:
    """The plain mean over scenes of the accuracy by chance, see ``ScoredScene.chance``; without an interval."""
    cells = {name: scene.chance(answerer, group) for name, scene in sorted(scenes.items())}
    scored = {name: cell for name, cell in cells.items() if cell.percent is not None}
    if not scored:
        return Cell()
    return Cell(percent=sum(cell.percent for cell in scored.values()) / len(scored), scenes=tuple(scored))


def _presence_summary(scenes: Iterable[ScoredScene]) -> str | None:
    """How often queries of whole scenes are answered; None without queries of absent things, as for other methods."""
    entries = [scene.document["presence"] for scene in scenes if "presence" in scene.document]

    def total(kind: str, key: str) -> int:
        return sum(entry[kind][key] for entry in entries)

    if not total("absent", "asked"):
        return None
    return (
        f"in queries of the whole scene, {total('present', 'answered')} of {total('present', 'asked')} present things "
        f"are answered, {total('present', 'right')} of them correctly, and {total('absent', 'answered')} of "
        f"{total('absent', 'asked')} absent things"
    )
