"""The benchmark's queries, asked frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.queries import Query
from egosplat.evaluation.scores import QueryScore, score_query
from egosplat.geometry import Array
from egosplat.progress import track
from egosplat.query.answer import Answer, ask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene
from egosplat.query.text import Texts


@dataclass(frozen=True, eq=False)
class Asked:
    """A query, what was answered without its maps, and the score.

    Attributes:
        query: what was asked.
        score: against the truth.
        relevancy: the largest.
        level, mask_level, pixel, position: see ``egosplat.query.answer.Answer``.
        mask_pixels: size of the mask.
    """

    query: Query
    score: QueryScore
    relevancy: float
    level: int | None
    pixel: tuple[int, int] | None
    position: Array | None
    mask_level: int | None
    mask_pixels: int


def ask_all(
    queries: Sequence[Query],
    evaluation: Evaluation,
    scene: QueryScene,
    texts: Texts,
    options: QueryOptions,
    hit_region: str,
) -> Iterator[Asked]:
    """Ask all queries, each in its frame.

    Args:
        queries: in frames that have a pose.
        evaluation: whose frames they are of.
        scene: is asked.
        texts: of all categories.
        options: how queries are answered.
        hit_region: see ``egosplat.evaluation.localization.target_area``.
    """
    wanted = {query.frame for query in queries}
    frames = [frame for frame in evaluation.frames if frame.index in wanted]
    for frame in track(frames, "asking"):
        own = [query for query in queries if query.frame == frame.index]
        truth, pose = evaluation.map_of(frame), evaluation.camera_to_world[frame.index]
        words = texts.of([query.category for query in own])
        answers = ask(scene, words, evaluation.camera, pose, evaluation.valid, options)
        for query, answer in zip(own, answers, strict=True):
            score = score_query(query, answer.candidates, answer.mask, truth, evaluation.valid, hit_region)
            yield _without_maps(query, answer, score)


def _without_maps(query: Query, answer: Answer, score: QueryScore) -> Asked:
    return Asked(
        query=query,
        score=score,
        relevancy=answer.score,
        level=answer.level,
        pixel=answer.pixel,
        position=answer.position,
        mask_level=answer.mask_level,
        mask_pixels=int(answer.mask.sum()),
    )
