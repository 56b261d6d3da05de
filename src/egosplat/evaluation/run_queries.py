"""Run the evaluation queries, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from egosplat.evaluation.evaluation_frames import Evaluation
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
        relevancy: largest smoothed relevancy, 0..1.
        level, mask_level, pixel, position: see ``egosplat.query.answer.ViewAnswer``.
    """

    query: Query
    score: QueryScore
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
) -> Iterator[AnsweredQuery]:
    """Answer and score all queries, each in its frame.

    Args:
        queries: queries in frames with a pose.
        asker: of a scene, with the queries among its texts.
        hit_region: see ``egosplat.evaluation.localization.target_area``.
    """
    # Frame by frame, because a frame is rendered once for all its queries.
    queried = {query.frame for query in queries}
    frames = [frame for frame in evaluation.frames if frame.index in queried]
    for frame in track(frames, "queries"):
        in_frame = [query for query in queries if query.frame == frame.index]
        instance_map, pose = evaluation.map_of(frame), evaluation.camera_to_world[frame.index]
        phrases = [query.category for query in in_frame]
        answers = asker.ask(phrases, evaluation.camera, pose, evaluation.valid)
        for query, answer in zip(in_frame, answers, strict=True):
            score = score_query(query, answer.pixel, answer.mask, instance_map, evaluation.valid, hit_region)
            yield _without_maps(query, answer, score)


def _without_maps(query: Query, answer: ViewAnswer, score: QueryScore) -> AnsweredQuery:
    return AnsweredQuery(
        query=query,
        score=score,
        relevancy=answer.score,
        level=answer.level,
        pixel=answer.pixel,
        position=answer.position,
        mask_level=answer.mask_level,
        mask_pixels=int(answer.mask.sum()),
    )
