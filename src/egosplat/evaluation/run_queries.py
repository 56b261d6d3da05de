"""Answer and score the evaluation queries, frame by frame."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import seconds_of
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import InstanceMap, Mask, Query, instances_of, mask_of, read_layers
from egosplat.evaluation.scores import QueryScore, score_query
from egosplat.frames.recording import Instance
from egosplat.geometry import Array
from egosplat.progress import track
from egosplat.query.answers import ViewMatch
from egosplat.query.views import Asker

# The value of ``metrics.masks`` that takes these masks.
CLASSES = "classes"


def count_right(query: Query, mask: Mask, layers: InstanceMap, instances: Sequence[Instance]) -> int:
    """Number of pixels of a query's mask that are labeled with its category and no other."""
    own, others = (
        [index for index, one in enumerate(instances) if (one.category == query.category) == same]
        for same in (True, False)
    )
    return int((mask & mask_of(layers, own) & ~mask_of(layers, others)).sum())


def pixel_accuracy(frames: Sequence[int], right: Sequence[int], pixels: int) -> float | None:
    """Share of the pixels that show the scene whose class is right, mean over frames, 0..1; None without queries.

    Pixels without a label count as wrong, as in 3D-OVS.

    Args:
        frames, right: frame and ``count_right`` of each query.
    """
    if not frames:
        return None
    return sum(right) / pixels / len({*frames})


# Answers phrases in a frame, in order.
Ask = Callable[[int, Sequence[str]], Iterable[ViewMatch]]


@dataclass(frozen=True, eq=False)
class AnsweredQuery:
    """A query with its score and its answer, without the answer's maps.

    Attributes:
        right_pixels: see ``count_right``; None unless masks are those of classes.
        relevancy: largest smoothed relevancy, 0..1.
        level, pixel, position, mask_level: see ``egosplat.query.answers.ViewMatch``.
    """

    query: Query
    score: QueryScore
    right_pixels: int | None
    relevancy: float
    level: str | None
    pixel: tuple[int, int] | None
    position: Array | None
    mask_level: str | None
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
    """Ask a scene at the time of a frame, with the masks of ``metrics.masks``; the asker has the texts of ``phrases_to_ask``."""
    seconds = seconds_of(evaluation.frames_artifact)

    def ask(frame: int, phrases: Sequence[str]) -> Iterator[ViewMatch]:
        place = evaluation.camera, evaluation.camera_to_world[frame], evaluation.valid
        return asker.ask(phrases, *place, float(seconds[frame]))

    return mask_classes(ask, asker.texts.phrases) if masks == CLASSES else ask


def mask_classes(ask: Ask, classes: Sequence[str]) -> Ask:
    """Give answers the masks of classes: the pixels where each is the most relevant one, the first of equal ones."""

    def ask_all(frame: int, phrases: Sequence[str]) -> Iterator[ViewMatch]:
        # Relevancy is 0 where nothing is visible, which is of no class.
        best, winner, kept = np.float32(0.0), np.int32(-1), {}
        for number, answer in enumerate(ask(frame, classes)):
            better = answer.relevancy > best
            best, winner = (
                np.where(better, answer.relevancy, best),
                np.where(better, np.int32(number), winner),
            )
            if answer.phrase in phrases:
                kept[answer.phrase] = number, answer
        for phrase in phrases:
            number, answer = kept[phrase]
            yield replace(answer, mask=winner == number, mask_level=answer.level)

    return ask_all
