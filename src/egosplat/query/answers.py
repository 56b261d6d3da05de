"""Turn answers to queries, of the whole scene or of one view, into rows of a table and images."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.poses import length_unit
from egosplat.artifacts.splats import camera_poses
from egosplat.geometry import Array
from egosplat.progress import track
from egosplat.query.answer import Answer, ask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene
from egosplat.query.scene_query import SceneAnswer, SceneIndex, ask_scene, index_scene
from egosplat.query.sources import QuerySources
from egosplat.query.text import Texts
from egosplat.query.thing_view import view_thing
from egosplat.query.things import Thing
from egosplat.query.viewpoint import Viewpoint

# Maximum number of answers in the picture; the table has all of them.
MOST_DRAWN = 8

# Longer side [px] of the relevancy and the mask in the picture of a scene query, where an image is 360 px high.
DRAWN_SIDE = 256

_ABSENT = "-"


@dataclass(frozen=True, eq=False)
class Question:
    """Queries and their scene.

    Attributes:
        texts: the queries, each once.
        untaught: words of each query that the model was not trained on.
    """

    texts: Texts
    untaught: Mapping[str, Sequence[str]]
    options: QueryOptions
    scene: QueryScene

    def refusal(self, phrase: str, score: float) -> str | None:
        """The reason why a query has no answer; None if it has one."""
        return self.options.refusal(score, self.untaught[phrase])


@dataclass(frozen=True, eq=False)
class DrawnAnswer:
    """An answer with its images; a query without an answer has only its phrase.

    Attributes:
        score: 0..1.
        refusal: reason why there is no answer, or None.
        where: name of the view, such as "frame 12".
        picture: (H, W, 3) float32 in [0, 1], the rendered view, or None.
        pixel: column and row of the location, or None.
        relevancy: (H, W) float32 in 0..1.
        level, mask_level: names of the levels of relevancy and mask.
        mask: (H, W) bool.
    """

    phrase: str
    score: float
    refusal: str | None = None
    where: str = ""
    picture: NDArray[np.float32] | None = None
    pixel: tuple[int, int] | None = None
    relevancy: NDArray[np.float32] | None = None
    level: str = ""
    mask: NDArray[np.bool_] | None = None
    mask_level: str = ""


@dataclass(frozen=True, eq=False)
class Answered:
    """All answers.

    Attributes:
        place: the queried scene or view, for the title.
        columns: column names of the table.
        rows: rows of the table; the row of a refused query has its phrase, its score and the reason.
        drawn: the first answers, for the picture; those of a scene are rendered as they are read.
        left_out: number of answers outside the picture.
    """

    place: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    drawn: Iterable[DrawnAnswer]
    left_out: int


def answer_in_scene(question: Question, sources: QuerySources, most: int) -> Answered:
    """Answer queries of the whole scene; the picture shows each query's best thing in the view that shows it best."""
    unit = length_unit(sources.poses)
    columns = ("query", "score", "level", f"center [{unit}]", f"size [{unit}]", "frame")
    poses, valid = camera_poses(sources.poses, sources.splats), sources.frames.read("valid")
    index = index_scene(question.scene, poses, question.scene.camera, valid)
    stream = ask_scene(index, question.texts, question.options, most)
    answers = list(track(stream, "queries", unit="answer", total=len(question.texts.phrases)))
    levels = sources.language.facts["levels"]
    rows = [row for answer in answers for row in _scene_rows(answer, question, index, levels)]
    drawn = (_draw_thing(answer, question, index, sources) for answer in answers[:MOST_DRAWN])
    return Answered("the whole scene", columns, rows, drawn, max(0, len(answers) - MOST_DRAWN))


def _scene_rows(
    answer: SceneAnswer, question: Question, index: SceneIndex, levels: Sequence[str]
) -> list[tuple[str, ...]]:
    if why := answer.refusal(question.untaught[answer.phrase], question.options):
        return [(answer.phrase, f"{answer.score:.2f}", why)]
    return [
        (
            answer.phrase if number == 0 else "",
            f"{thing.score:.2f}",
            levels[thing.level],
            _numbers(thing.center),
            " x ".join(f"{side:.2f}" for side in thing.high - thing.low),
            str(index.best_frame(thing)),
        )
        for number, thing in enumerate(answer.fitting(question.options))
    ]


def _draw_thing(
    answer: SceneAnswer, question: Question, index: SceneIndex, sources: QuerySources
) -> DrawnAnswer:
    if why := answer.refusal(question.untaught[answer.phrase], question.options):
        return DrawnAnswer(answer.phrase, answer.score, refusal=why)
    thing: Thing = answer.things[0]
    frame = index.best_frame(thing)
    pose = camera_poses(sources.poses, sources.splats)[frame]
    texts, camera = question.texts.of([answer.phrase]), question.scene.camera
    valid = sources.frames.read("valid")
    options = replace(question.options, resolution=DRAWN_SIDE)
    seen = view_thing(question.scene, thing, texts, camera, pose, valid, options)
    level = sources.language.facts["levels"][thing.level]
    return DrawnAnswer(
        answer.phrase,
        answer.score,
        where=f"frame {frame}",
        picture=question.scene.picture(camera, pose),
        pixel=seen.pixel,
        relevancy=seen.relevancy,
        level=level,
        mask=seen.mask,
        mask_level=level,
    )


def answer_in_view(question: Question, sources: QuerySources, viewpoint: Viewpoint) -> Answered:
    """Answer queries in one view."""
    camera, pose = question.scene.camera, viewpoint.camera_to_world
    unit = length_unit(sources.poses)
    columns = ("query", "score", "level", "pixel", f"position [{unit}]")
    picture = question.scene.picture(camera, pose)
    levels = sources.language.facts["levels"]
    stream = ask(question.scene, question.texts, camera, pose, viewpoint.valid, question.options)
    rows: list[tuple[str, ...]] = []
    drawn: list[DrawnAnswer] = []
    # Answers hold maps of the image's size, so they are not kept.
    for answer in track(stream, "queries", unit="answer", total=len(question.texts.phrases)):
        why = question.refusal(answer.phrase, answer.score)
        rows.append(_view_row(answer, levels, why))
        if len(drawn) < MOST_DRAWN:
            drawn.append(_draw_view(answer, levels, why, picture))
    return Answered(viewpoint.name, columns, rows, drawn, len(rows) - len(drawn))


def _view_row(answer: Answer, levels: Sequence[str], why: str | None) -> tuple[str, ...]:
    if why or answer.level is None or answer.pixel is None:
        return (answer.phrase, f"{answer.score:.2f}", why or _ABSENT)
    return (
        answer.phrase,
        f"{answer.score:.2f}",
        levels[answer.level],
        f"{answer.pixel[0]}, {answer.pixel[1]}",
        _ABSENT if answer.position is None else _numbers(answer.position),
    )


def _draw_view(
    answer: Answer, levels: Sequence[str], why: str | None, picture: NDArray[np.float32]
) -> DrawnAnswer:
    if why or answer.level is None or answer.mask_level is None:
        return DrawnAnswer(answer.phrase, answer.score, refusal=why)
    return DrawnAnswer(
        answer.phrase,
        answer.score,
        picture=picture,
        pixel=answer.pixel,
        relevancy=answer.relevancy,
        level=levels[answer.level],
        mask=answer.mask,
        mask_level=levels[answer.mask_level],
    )


def _numbers(point: Array) -> str:
    return ", ".join(f"{one:.2f}" for one in point)
