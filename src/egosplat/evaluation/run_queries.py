"""Answer and score the evaluation queries, frame by frame."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from egosplat.artifacts.reader import Artifact
from egosplat.evaluation.classes import CLASSES, ClassMap, count_right
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import Mask, Query, instances_of, read_layers
from egosplat.evaluation.scores import QueryScore, score_query
from egosplat.geometry import Array
from egosplat.progress import track
from egosplat.query.answer import Asker, ViewAnswer

# Answers phrases in a frame, in order.
Ask = Callable[[int, Sequence[str]], Iterable[ViewAnswer]]


@dataclass(frozen=True, eq=False)
class AnsweredQuery:
    """A query with its score and its answer, without the answer's maps.

    Attributes:
        right_pixels: see ``egosplat.evaluation.classes.count_right``; None unless masks are those of classes.
        relevancy: largest smoothed relevancy, 0..1.
        level, pixel, position, mask_level: see ``egosplat.query.answer.ViewAnswer``.
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
    queries: Iterable[Query], ask: Ask, annotations: Artifact, valid: Mask, options: ScoringOptions
) -> Iterator[AnsweredQuery]:
    """Answer and score queries, frame by frame, because a frame is rendered once for all its queries."""
    instances, by_frame = instances_of(annotations), {}
    for query in queries:
        by_frame.setdefault(query.frame, []).append(query)
    for frame, in_frame in track(list(by_frame.items()), "queries"):
        layers = read_layers(annotations, in_frame[0].row, valid)
        answers = ask(frame, [query.category for query in in_frame])
        for query, answer in zip(in_frame, answers, strict=True):
            right = count_right(query, answer.mask, layers, instances) if options.masks == CLASSES else None
            yield AnsweredQuery(
                query,
                score_query(query, answer.pixel, answer.mask, layers, valid, options.hit_region),
                right,
                answer.score,
                answer.level,
                answer.pixel,
                answer.position,
                answer.mask_level,
                int(answer.mask.sum()),
            )


def ask_of(evaluation: Evaluation, asker: Asker, masks: str = "threshold") -> Ask:
    """Ask a scene, with the masks of ``metrics.masks``; the asker has the texts of ``phrases_to_ask``."""

    def ask(frame: int, phrases: Sequence[str]) -> Iterator[ViewAnswer]:
        return asker.ask(phrases, evaluation.camera, evaluation.camera_to_world[frame], evaluation.valid)

    return mask_classes(ask, asker.texts.phrases) if masks == CLASSES else ask


def mask_classes(ask: Ask, classes: Sequence[str]) -> Ask:
    """Give answers the masks of classes."""

    def ask_all(frame: int, phrases: Sequence[str]) -> Iterator[ViewAnswer]:
        found, kept = ClassMap(), {}
        for answer in ask(frame, classes):
            found.add(answer.phrase, answer.relevancy)
            if answer.phrase in phrases:
                kept[answer.phrase] = answer
        for phrase in phrases:
            yield replace(kept[phrase], mask=found.mask(phrase), mask_level=kept[phrase].level)

    return ask_all
