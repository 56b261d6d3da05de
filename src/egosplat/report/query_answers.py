"""Answers to queries as rows of a table and as pictures, of the whole scene or of one view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.poses import length_unit
from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array
from egosplat.progress import track
from egosplat.query.answer import Answer, ask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene
from egosplat.query.scene_query import SceneAnswer, SceneIndex, ask_scene, index_scene
from egosplat.query.text import Texts
from egosplat.query.thing_view import view_thing
from egosplat.query.things import Thing
from egosplat.query.verdict import refusal
from egosplat.query.viewpoint import Viewpoint
from egosplat.report.query_sheet import DrawnAnswer

MOST_DRAWN = 8
"""Answers in the picture; more are in the table alone, so that many queries take no longer for pictures."""


_ABSENT = "-"


@dataclass(frozen=True)
class QuerySources:
    """Artifacts of one scene that belong together."""

    frames: Artifact
    poses: Artifact
    features: Artifact
    splats: Artifact
    language: Artifact


@dataclass(frozen=True, eq=False)
class Question:
    """Queries and the scene that they are asked of.

    Attributes:
        texts: the queries, each once.
        untaught: for each query, its words that the model was not trained on.
        options: how queries are answered.
        scene: is asked and rendered.
    """

    texts: Texts
    untaught: Mapping[str, Sequence[str]]
    options: QueryOptions
    scene: QueryScene

    def refusal(self, phrase: str, score: float) -> str | None:
        """Why a query has no answer, in words; None where it has one."""
        return refusal(score, self.untaught[phrase], self.options.min_score)


@dataclass(frozen=True, eq=False)
class Answered:
    """All answers.

    Attributes:
        place: what was asked, in words.
        columns: of the table.
        rows: of the table; a row of a refused query is its phrase, its score and a sentence.
        drawn: the first answers.
        left_out: number of answers that are not drawn.
    """

    place: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    drawn: Sequence[DrawnAnswer]
    left_out: int


def answer_in_scene(question: Question, sources: QuerySources, most: int) -> Answered:
    """Find each query's things in 3D, and draw the best one in the view that shows it best."""
    unit = length_unit(sources.poses)
    columns = ("query", "score", "level", f"centre [{unit}]", f"size [{unit}]", "frame")
    index = index_scene(question.scene, sources.poses, question.scene.camera, sources.frames.read("valid"))
    asked = ask_scene(index, question.texts, question.options, most)
    answers = list(track(asked, "asking", unit="answer", total=len(question.texts.phrases)))
    levels = sources.language.facts["levels"]
    rows = [row for answer in answers for row in _scene_rows(answer, question, index, levels)]
    drawn = [_draw_thing(answer, question, index, sources) for answer in answers[:MOST_DRAWN]]
    return Answered("the whole scene", columns, rows, drawn, len(answers) - len(drawn))


def _scene_rows(
    answer: SceneAnswer, question: Question, index: SceneIndex, levels: Sequence[str]
) -> list[tuple[str, ...]]:
    if why := _why_refused(answer, question):
        return [(answer.phrase, f"{answer.score:.2f}", why)]
    found = [thing for thing in answer.things if thing.score >= question.options.min_score]
    return [
        (
            answer.phrase if number == 0 else "",
            f"{thing.score:.2f}",
            levels[thing.level],
            _numbers(thing.centre),
            " x ".join(f"{side:.2f}" for side in thing.high - thing.low),
            str(index.best_frame(thing)),
        )
        for number, thing in enumerate(found)
    ]


def _why_refused(answer: SceneAnswer, question: Question) -> str | None:
    why = question.refusal(answer.phrase, answer.score)
    return why if why or answer.things else "nothing of the scene has a code"


def _draw_thing(
    answer: SceneAnswer, question: Question, index: SceneIndex, sources: QuerySources
) -> DrawnAnswer:
    if why := _why_refused(answer, question):
        return DrawnAnswer(answer.phrase, answer.score, refusal=why)
    thing: Thing = answer.things[0]
    frame = index.best_frame(thing)
    pose = sources.poses.read("camera_to_world")[frame]
    texts, camera = question.texts.of([answer.phrase]), question.scene.camera
    valid = sources.frames.read("valid")
    seen = view_thing(question.scene, thing, texts, camera, pose, valid, question.options)
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
    """Find each query in one view."""
    camera, pose = question.scene.camera, viewpoint.camera_to_world
    unit = length_unit(sources.poses)
    columns = ("query", "score", "level", "pixel", f"position [{unit}]")
    picture = question.scene.picture(camera, pose)
    levels = sources.language.facts["levels"]
    asked = ask(question.scene, question.texts, camera, pose, viewpoint.valid, question.options)
    rows: list[tuple[str, ...]] = []
    drawn: list[DrawnAnswer] = []
    # Answers hold maps of the picture's size, so they are not kept.
    for answer in track(asked, "asking", unit="answer", total=len(question.texts.phrases)):
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
