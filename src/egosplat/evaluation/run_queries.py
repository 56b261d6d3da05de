"""Run the evaluation queries, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from egosplat.evaluation.classes import CLASSES, ClassMap, count_right
from egosplat.evaluation.evaluation_frames import Evaluation, Frame
from egosplat.evaluation.queries import Query
from egosplat.evaluation.scores import QueryScore, score_query
from egosplat.geometry import Array
from egosplat.progress import track
from egosplat.query.answer import Asker, ViewAnswer


@dataclass(frozen=True, eq=False)
class AnsweredQuery:
    """A query with its score and its answer, without the answer's maps.

    Attributes:
        score: score against the annotation.
        right_pixels: see ``egosplat.evaluation.classes.count_right``; None unless masks are those of classes.
        relevancy: largest smoothed relevancy, 0..1.
        level, mask_level, pixel, position: see ``egosplat.query.answer.ViewAnswer``.
    """

    query: Query
    score: QueryScore
    right_pixels: int | None
    relevancy: float
    level: int | None
    pixel: tuple[int, int] | None
    position: Array | None
    mask_level: int | None
    mask_pixels: int


def run_queries(
    queries: Sequence[Query],
    evaluation: Evaluation,
    asker: Asker,
    hit_region: str,
    masks: str = "threshold",
) -> Iterator[AnsweredQuery]:
    """Answer and score all queries, each in its frame.

    Args:
        queries: queries in frames with a pose.
        asker: of a scene, with the texts of ``egosplat.evaluation.queries.phrases_to_ask``.
        masks: ``metrics.masks``.
        hit_region: see ``egosplat.evaluation.localization.target_area``.
    """
    # Frame by frame, because a frame is rendered once for all its queries.
    queried = {query.frame for query in queries}
    frames = [frame for frame in evaluation.frames if frame.index in queried]
    for frame in track(frames, "queries"):
        in_frame = [query for query in queries if query.frame == frame.index]
        layers = evaluation.layers_of(frame)
        answers = answer_frame([query.category for query in in_frame], evaluation, frame, asker, masks)
        for query, answer in zip(in_frame, answers, strict=True):
            score = score_query(query, answer.pixel, answer.mask, layers, evaluation.valid, hit_region)
            of_class = masks == CLASSES
            right = count_right(query, answer.mask, layers, evaluation.instances) if of_class else None
            yield _without_maps(query, answer, score, right)


def answer_frame(
    phrases: Sequence[str], evaluation: Evaluation, frame: Frame, asker: Asker, masks: str
) -> Iterator[ViewAnswer]:
    """Answer queries in a frame, in order; arguments as of ``run_queries``."""
    view = evaluation.camera, evaluation.camera_to_world[frame.index], evaluation.valid
    if masks != CLASSES:
        yield from asker.ask(phrases, *view)
        return
    found, kept = ClassMap(), {}
    for answer in asker.ask(asker.texts.phrases, *view):
        found.add(answer.phrase, answer.relevancy)
        if answer.phrase in phrases:
            kept[answer.phrase] = answer
    for phrase in phrases:
        yield replace(kept[phrase], mask=found.mask(phrase), mask_level=kept[phrase].level)


def _without_maps(
    query: Query, answer: ViewAnswer, score: QueryScore, right_pixels: int | None
) -> AnsweredQuery:
    return AnsweredQuery(
        query=query,
        score=score,
        right_pixels=right_pixels,
        relevancy=answer.score,
        level=answer.level,
        pixel=answer.pixel,
        position=answer.position,
        mask_level=answer.mask_level,
        mask_pixels=int(answer.mask.sum()),
    )
