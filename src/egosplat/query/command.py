"""Query a finished scene: ``egosplat query``."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.geometry import Array
from egosplat.histories.told import Place, clock
from egosplat.progress import track
from egosplat.query.answers import NOTHING, Answer
from egosplat.query.finished_scene import Scene
from egosplat.query.grades.calibration import Grading, grading_by_score
from egosplat.query.text import clean_phrase
from egosplat.query.viewpoint import Viewpoint

# Maximum number of answers in the picture; the table has all of them.
MOST_DRAWN = 8

# Longer side [px] of the relevancy and the mask in the picture of a scene query, where an image is 360 px high.
DRAWN_SIDE = 256

_ABSENT = "-"


def run(
    scene: Scene,
    phrases: Sequence[str],
    viewpoint: Viewpoint | None,
    most: int,
    output: Path,
    at: float | None = None,
) -> Iterator[str]:
    """Answer queries in a table, then in a picture.

    Args:
        phrases: the queries, at least one.
        viewpoint: the view to query; None for the whole scene.
        most: maximum number of things in an answer of the whole scene.
        output: picture to write.
        at: tell where things that were carried were at this time [s since the first frame]; of a pose, ask what it shows then.

    Yields:
        The table as soon as it is known, a table of what was carried if there is any, then a line about the picture once it is drawn.

    Raises:
        UserError: as ``Scene.ask``; or the recording has ended before ``at``, or a frame is asked of a time.
    """
    viewpoint, at = _at_time(scene, viewpoint, at)
    place = "the whole scene" if viewpoint is None else viewpoint.name
    title = f"{scene.folder}, {place}, origin {scene.origin}"
    grading = scene.grading() if viewpoint is None else grading_by_score(scene.options)
    # A view is never calibrated; saying so with each would tell nothing.
    notices = (grading.notice, scene.untold) if viewpoint is None else ()
    title = "\n".join(filter(None, (title, scene.notice, *notices)))
    queries = list(dict.fromkeys(map(clean_phrase, phrases)))
    answers = track(scene.answers(queries, most, viewpoint), "queries", unit="answer", total=len(queries))
    kept: list[Answer] = []
    rows: list[tuple[str, ...]] = []
    for answer in answers:
        rows += _scene_rows(answer, grading) if viewpoint is None else [_view_row(answer, grading)]
        # Answers in a view hold maps of its size: those that are drawn are kept.
        if viewpoint is None or len(kept) < MOST_DRAWN:
            kept.append(answer)
    columns = ("pixel", "position [{}]") if viewpoint else ("center [{}]", "size [{}]", "frame")
    measured = ("query", "answer", grading.measure, "level", *(one.format(scene.unit) for one in columns))
    yield f"{title}\n{answers_table(measured, rows)}"
    if carried := _carried_table(kept, scene.unit, at):
        yield f"\n{carried}"
    # Here, because matplotlib takes as long to import as a query to answer.
    from egosplat.query.sheet import draw_answers

    if viewpoint is None:
        drawn = [_render_thing(scene, answer) for answer in kept[:MOST_DRAWN]]
    else:
        picture = scene.picture(viewpoint)
        drawn = [(answer, "", picture if answer.view else None) for answer in kept]
    draw_answers(drawn, title, output)
    left_out = len(queries) - len(drawn)
    more = f" (the first {MOST_DRAWN} answers; {left_out} more are in the table only)"
    yield f"picture: {output}{more if left_out else ''}"


def _at_time(
    scene: Scene, viewpoint: Viewpoint | None, at: float | None
) -> tuple[Viewpoint | None, float | None]:
    """The viewpoint at a time, or the time at which the whole scene is asked."""
    if at is None:
        return viewpoint, None
    if viewpoint is not None and viewpoint.second is not None:
        raise UserError(f"--at: {viewpoint.name} has its own time; ask the whole scene, or a pose")
    # By the whole seconds that a user sees: 0:59.9 is at the end of a recording that ends at 0:59.
    if int(at) > scene.seconds[-1]:
        raise UserError(f"--at {clock(at)}: the recording ends at {clock(float(scene.seconds[-1]))}")
    if viewpoint is None:
        return None, at
    return replace(viewpoint, name=f"{viewpoint.name} at {clock(at)}", second=at), None


def answers_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table with aligned columns, one line per row.

    Args:
        columns: C column names.
        rows: rows of C cells. The last cell of a shorter row is a sentence that does not widen its column.
    """
    every = [columns, *rows]
    cells = [row if len(row) == len(columns) else row[:-1] for row in every]
    widths = [max(len(row[place]) for row in cells if place < len(row)) for place in range(len(columns))]
    lines = ("  ".join(map(str.ljust, row, [*widths[: len(row) - 1], 0])).rstrip() for row in every)
    return "\n".join(lines)


def _scene_rows(answer: Answer, grading: Grading) -> list[tuple[str, ...]]:
    if answer.refusal:
        return [_refused_row(answer, grading)]
    return [
        (
            answer.phrase if number == 0 else "",
            answer.grade,
            grading.shown(thing.rating),
            thing.level,
            _numbers(thing.center),
            " x ".join(f"{side:.2f}" for side in thing.size),
            str(thing.frame),
        )
        for number, thing in enumerate(answer.things)
    ]


def _carried_table(answers: Sequence[Answer], unit: str, at: float | None) -> str:
    """When what was asked for was carried, or where it was at a time; empty if nothing is known and no time is asked of."""
    answers = [one for one in answers if one.history]
    if not answers:
        return "" if at is None else "nothing of this was carried, as far as is known"
    if at is not None:
        rows = [(one.phrase, *_place_cells(one.at(at))) for one in answers]
        return answers_table(("carried thing", f"at {clock(at)} [{unit}]", "for how long [min:s]"), rows)
    columns = ("carried thing", "carried [min:s]", f"from [{unit}]", f"to [{unit}]", "frame")
    rows = [
        (
            answer.phrase if number == 0 else "",
            one.told,
            _numbers(one.start) if one.start_is_known else _ABSENT,
            _numbers(one.end) if one.end_is_known else _ABSENT,
            str(one.frame),
        )
        for answer in answers
        for number, one in enumerate(answer.history)
    ]
    return answers_table(columns, rows)


def _place_cells(place: Place | None) -> tuple[str, str]:
    if place is None:
        return _ABSENT, _ABSENT
    return _ABSENT if place.position is None else _numbers(place.position), place.told


# What moves is masked: a carried thing is found nowhere, and yet known.
_CARRIED = "carried about: not found among what stays"


def _refused_row(answer: Answer, grading: Grading) -> tuple[str, ...]:
    """A row whose last cell says why, with the number that it was graded by, if that means anything."""
    graded = answer.rating > 0 and not answer.untaught
    number = f" ({grading.measure} {grading.shown(answer.rating)})" if graded else ""
    reason = _CARRIED if answer.history else answer.refusal
    return answer.phrase, f"{reason}{number}"


def _view_row(answer: Answer, grading: Grading) -> tuple[str, ...]:
    view = answer.view
    if answer.refusal:
        return _refused_row(answer, grading)
    if view is None or view.pixel is None or view.level is None:
        return answer.phrase, NOTHING
    position = _ABSENT if view.position is None else _numbers(view.position)
    place = f"{view.pixel[0]}, {view.pixel[1]}"
    return answer.phrase, answer.grade, grading.shown(answer.rating), view.level, place, position


def _render_thing(scene: Scene, answer: Answer) -> tuple[Answer, str, NDArray | None]:
    """The best thing of an answer in the frame that shows it best."""
    if not answer.things:
        return answer, "", None
    thing = answer.things[0]
    view = scene.show(answer.phrase, thing, DRAWN_SIDE)
    return replace(answer, view=view), f"frame {thing.frame}", scene.render(thing.frame)


def _numbers(point: Array) -> str:
    return ", ".join(f"{one:.2f}" for one in point)
