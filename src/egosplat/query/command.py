"""Query a finished scene, in a table and on a page of pictures: ``egosplat query``."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Array
from egosplat.errors import UserError
from egosplat.histories.told import clock
from egosplat.models.suitability import notice_of_artifacts
from egosplat.progress import track
from egosplat.query.answers import Answer, as_json
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import NOT_ASKED, Grading, by_score
from egosplat.query.scene import Viewpoint

# Maximum number of answers in the picture; the table has all of them.
MOST_DRAWN = 8

# Longer side [px] of the relevancy and the mask in the picture of a scene query, and height of an image there [inches].
DRAWN_SIDE, CELL = 256, 4.0

# An answer with its match in a view, the view's name if each answer has its own, and its (H, W, 3) picture in [0, 1].
DrawnAnswer = tuple[Answer, str, NDArray | None]


def run(
    scene: Scene,
    phrases: Sequence[str],
    viewpoint: Viewpoint | None,
    most: int,
    output: Path,
    at: float | None = None,
) -> Iterator[str]:
    """Answer queries, of the whole scene by ``most`` things each, or of a viewpoint; tell where carried things were ``at`` a time [s].

    Yields the table, one of what was carried if anything was, then a line about the picture once it is drawn. UserError: as
    ``Scene.ask``; or the recording has ended before ``at``, or a frame is asked of a time."""
    viewpoint = _viewpoint_at(scene, viewpoint, at)
    place = "the whole scene" if viewpoint is None else viewpoint.name
    notice = notice_of_artifacts(scene.made_from.found.values())
    lines = [f"{scene.folder}, {place}, origin {scene.origin}", notice]
    grading, columns = by_score(scene.options.min_score), ("pixel", "position [{}]")
    if viewpoint is None:
        grading, columns = scene.grading(), ("center [{}]", "size [{}]", "frame")
        # A view is never calibrated; saying so with each would tell nothing.
        lines.append(grading.notice)
        if scene.ruler:
            unit, low, high = (scene.ruler[0] * np.exp(side * scene.ruler[1]) for side in (0, -1, 1))
            told = f"a scene unit is about {unit:.2g} m ({low:.2g} to {high:.2g}), by the sizes of things"
            lines.append(told)
    title, questions = "\n".join(filter(None, lines)), scene.read(phrases)
    rows = [("query", "answer", grading.measure, "level", *(name.format(scene.unit) for name in columns))]
    kept: list[Answer] = []
    count = refused = 0
    sentences: list[str] = []
    answers = scene.reply(questions, most, viewpoint)
    for answer in track(answers, "queries", unit="answer", total=len(questions)):
        rows += answer_rows(answer, grading)
        sentences += _sentence(answer, scene.unit, output)
        count, refused = count + 1, refused + (answer.grade == NOT_ASKED)
        # Answers in a view hold maps of its size: those that are drawn are kept.
        if answer.grade != NOT_ASKED and (viewpoint is None or len(kept) < MOST_DRAWN):
            kept.append(answer)
    yield f"{title}\n{align_rows(rows)}"
    if sentences:
        yield "\n".join(["", *sentences])
    if carried := carried_table(kept, scene.unit, at if viewpoint is None else None):
        yield f"\n{carried}"
    if viewpoint is None:
        drawn = [_render_thing(scene, answer) for answer in kept[:MOST_DRAWN]]
    else:
        shown = scene.trained.at(scene.rests, viewpoint.second)
        picture = shown.picture(scene.camera, viewpoint.camera_to_world)
        drawn = [(answer, "", picture if answer.view else None) for answer in kept]
    left_out = count - refused - len(drawn)
    more = f" (the first {MOST_DRAWN} answers; {left_out} more are in the table only)"
    if drawn:
        draw_answers(drawn, title, output)
        yield f"picture: {output}{more if left_out else ''}"
    if refused:
        raise UserError(f"{refused} of {count} questions could not be asked: the table says why")


def list_answers(
    scene: Scene, phrases: Sequence[str], viewpoint: Viewpoint | None, most: int, at: float | None
) -> list[dict[str, Any]]:
    """Answer queries for JSON. Raises as ``run``, but refuses no question."""
    viewpoint = _viewpoint_at(scene, viewpoint, at)
    return [describe(scene, answer, at) for answer in scene.reply(scene.read(phrases), most, viewpoint)]


def describe(scene: Scene, answer: Answer, at: float | None = None) -> dict[str, Any]:
    """An answer for JSON, with what was typed, how it was read, where it was ``then``, times [s], and what is told of the scene."""
    typed = answer.question.typed if answer.question else answer.phrase
    facts = as_json(answer) | {"typed": typed, "asked": answer.asked, "scene": str(scene.folder)}
    for shown in filter(None, (*facts["things"], facts["moving"])):
        shown["second"] = round(float(scene.seconds[shown["frame"]]), 2)
    notice = notice_of_artifacts(scene.made_from.found.values())
    facts |= {"unit": scene.unit, "origin": scene.origin, "notice": notice}
    return facts | {"then": None if at is None else as_json(answer.at(at))}


def _viewpoint_at(scene: Scene, viewpoint: Viewpoint | None, at: float | None) -> Viewpoint | None:
    """The viewpoint at a time, if one is given; None for the whole scene."""
    if at is None:
        return viewpoint
    if viewpoint is not None and viewpoint.second is not None:
        raise UserError(f"--at: {viewpoint.name} has its own time; ask the whole scene, or a pose")
    # By the whole seconds that a user sees: 0:59.9 is at the end of a recording that ends at 0:59.
    if int(at) > scene.seconds[-1]:
        raise UserError(f"--at {clock(at)}: the recording ends at {clock(float(scene.seconds[-1]))}")
    return viewpoint and replace(viewpoint, name=f"{viewpoint.name} at {clock(at)}", second=at)


def align_rows(rows: Sequence[Sequence[str]]) -> str:
    """Align the columns that the first row names; the last cell of a shorter row is a sentence that does not widen its column."""
    count = len(rows[0])
    cells = [row if len(row) == count else row[:-1] for row in rows]
    widths = [max(len(row[column]) for row in cells if column < len(row)) for column in range(count)]
    lines = ("  ".join(map(str.ljust, row, [*widths[: len(row) - 1], 0])).rstrip() for row in rows)
    return "\n".join(lines)


def answer_rows(answer: Answer, grading: Grading) -> list[tuple[str, ...]]:
    """The rows of an answer; of one that is refused the last cell says why, with the number that it was graded by, if that means anything."""
    view, shown = answer.view, grading.shown(answer.rating)
    if answer.question and answer.grade == NOT_ASKED:
        return [(repr(answer.question.typed)[:40], answer.refusal or "")]
    if moving := answer.moving:
        told = f"{moving.told}  frame {moving.frame}"
        rated = "-" if moving.rating is None else grading.shown(moving.rating)
        return [(answer.asked, answer.grade, rated, "-", told)]
    if reason := _refusal(answer):
        graded = answer.rating > 0 and not answer.untaught
        return [(answer.asked, f"{reason} ({grading.measure} {shown})" if graded else reason)]
    if view is not None and view.pixel is not None and view.level is not None:
        pixel = f"{view.pixel[0]}, {view.pixel[1]}"
        return [(answer.asked, answer.grade, shown, view.level, pixel, show_point(view.position))]
    rows: list[tuple[str, ...]] = []
    for thing in answer.things:
        place = show_point(thing.center), show_size(thing.size)
        about = answer.grade, grading.shown(thing.rating), thing.level, *place
        rows.append(("" if rows else answer.asked, *about, str(thing.frame)))
    return rows


def _refusal(answer: Answer) -> str | None:
    """Why nothing is found. What moves is masked: a carried thing is found nowhere, and yet known."""
    is_carried = answer.history and not answer.moving and not (answer.question and answer.question.relation)
    return "it was carried, so it has no single place" if answer.refusal and is_carried else answer.refusal


def carried_table(answers: Sequence[Answer], unit: str, at: float | None) -> str:
    """When what was asked for was carried, or where it was at a time; empty if nothing is known and no time is asked of."""
    answers = [answer for answer in answers if answer.history]
    if not answers:
        return "" if at is None else "nothing of this was carried, as far as is known"
    if at is not None:
        rows = [("carried thing", f"at {clock(at)} [{unit}]", "when [min:s]")]
        places = [(answer.phrase, place) for answer in answers if (place := answer.at(at))]
        rows += [(phrase, show_point(place.position), place.told) for phrase, place in places]
        return align_rows(rows)
    rows = [("carried thing", "carried [min:s]", f"from [{unit}]", f"to [{unit}]", "frame")]
    for answer in answers:
        for number, one in enumerate(answer.history):
            ends = show_point(one.start), show_point(one.end)
            rows.append((answer.phrase if number == 0 else "", one.told, *ends, str(one.frame)))
    return align_rows(rows)


def _sentence(answer: Answer, unit: str, output: Path) -> list[str]:
    """Lines that answer a question which was read otherwise than typed."""
    question = answer.question
    if question is None or question.read == question.typed or answer.grade == NOT_ASKED:
        return []
    told = _refusal(answer)
    if best := next(iter(answer.things), None):
        shown = f"at {show_point(best.center)} {unit}, best seen in frame {best.frame}"
        more = f"; {len(answer.things) - 1} more" if answer.things[1:] else ""
        told = f"{answer.grade}: {question.said} {shown} ({output}){more}"
    elif not told:
        told = f"{answer.grade}: {question.said} ({output})"
    return [f'"{question.typed}" (read as: {question.read}): {told}']


def show_point(point: Array | None) -> str:
    """A place in a table; a dash if it is not known."""
    if point is None or not np.isfinite(point).all():
        return "-"
    return ", ".join(f"{one:.2f}" for one in point)


def show_size(size: Array) -> str:
    """The sides of a box in a table."""
    return " x ".join(f"{side:.2f}" for side in size)


def _render_thing(scene: Scene, answer: Answer) -> DrawnAnswer:
    """The best thing of an answer in the frame that shows it best; what moves, which is not rendered, in the photograph."""
    if (best := answer.moving or next(iter(answer.things), None)) is None:
        return answer, "", None
    view = scene.show(answer.phrase, best, DRAWN_SIDE)
    picture = scene.render(best.frame) if answer.things else scene.frames[best.frame] / np.float32(255)
    return replace(answer, view=view), f"frame {best.frame}", picture


def draw_answers(answers: Sequence[DrawnAnswer], title: str, output: Path) -> None:
    """Draw a page as PNG, atomically: for each of some answers the location, the relevancy and the mask in the rendered view."""
    # Here, because matplotlib takes as long to import as a query to answer.
    from egosplat.drawing import HEADING_WIDTH, draw_heat, draw_mask, empty_grid, plt, save_figure, wrap_text

    shapes = [picture.shape for _, _, picture in answers if picture is not None]
    height, width = shapes[0][:2] if shapes else (1, 1)
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    # A refused query takes one line.
    heights = [0.6 if picture is None else CELL + 0.35 for _, _, picture in answers]
    figure = plt.figure(figsize=(3 * cell, sum(heights) + 0.8), layout="constrained")
    grid = empty_grid(figure, len(answers), 3, height_ratios=heights)
    figure.suptitle(title, fontsize=12)
    for (answer, where, picture), cells in zip(answers, grid, strict=True):
        (place, heat, mask), view = cells, answer.view
        if picture is None or view is None:
            caption = f'"{answer.asked}": {_refusal(answer)}'
            # Outside of the layout: otherwise the first column becomes as wide as the text.
            how = {"transform": place.transAxes, "clip_on": False, "in_layout": False}
            wrap_text(place.text(0.0, 0.5, caption, fontsize=10, **how), HEADING_WIDTH * figure.bbox.width)
            continue
        place.set_title(f'"{answer.asked}": {answer.grade}{where and f", {where}"}', fontsize=10)
        place.imshow(picture)
        draw_heat(heat, picture, view.relevancy)
        heat.set_title(f"relevancy 0 to 1, {view.level}", fontsize=10)
        for axes in (place, heat):
            for color, width in (("black", 3.5), ("white", 1.5)) if view.pixel else ():
                axes.scatter(*view.pixel or (), s=130, facecolors="none", edgecolors=color, linewidths=width)
        draw_mask(mask, picture, view.mask)
        mask.set_title(f"mask, {view.mask_level}", fontsize=10)
    save_figure(figure, output)
