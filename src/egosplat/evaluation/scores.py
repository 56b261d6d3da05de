"""Answer the evaluation queries frame by frame, and score them, alone and in the groups static, dynamic and all."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from egosplat.arrays import Bools, Ints, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import seconds_of
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.intervals import cluster, clustered_interval
from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import GROUPS, Query, instances_of, mask_of, read_layers
from egosplat.frames.recording import Instance
from egosplat.progress import track
from egosplat.query.answers import ViewMatch
from egosplat.query.scene import Viewpoint
from egosplat.query.views import Asker

# Constant answers by their key in the scores: their accuracy is the chance level.
CHANCE = {"random_pixel": "a random pixel", "middle_pixel": "the middle of the picture"}

# Answers phrases in a frame, in order.
Ask = Callable[[int, Sequence[str]], Iterable[ViewMatch]]


@dataclass(frozen=True)
class Result:
    """Scores of an answer against the instances of one group: whether it hits, IoU of its mask, 0..1, the probability that a
    random valid pixel hits, and whether the middle pixel of the image does."""

    hit: bool
    iou: float
    random_hit: float
    middle_hit: bool


def score_query(
    query: Query, pixel: tuple[int, int] | None, mask: Bools, layers: Ints32, valid: Bools
) -> dict[str, Result]:
    """Score the pixel and mask of one ``ViewMatch`` against the instances of each group, in (..., H, W) int32 layers of its
    frame, see ``read_layers``; (H, W) bool ``valid`` pixels show the scene."""
    results = {}
    for name, members in query.instances.items():
        area = target_area(layers, members)
        height, width = area.shape
        results[name] = Result(
            hit=pixel is not None and bool(area[pixel[1], pixel[0]]),
            iou=iou(mask, mask_of(layers, members), valid),
            random_hit=float(area[valid].mean()),
            middle_hit=bool(area[height // 2, width // 2]),
        )
    return results


def iou(predicted: Bools, target: Bools, valid: Bools) -> float:
    """Intersection over union of two (H, W) bool masks over the valid pixels, 0..1; the target has a valid pixel."""
    predicted, target = predicted & valid, target & valid
    assert target.any()
    return float((predicted & target).sum() / (predicted | target).sum())


def summarise(categories: Sequence[str], scores: Sequence[Mapping[str, Result]]) -> dict[str, dict[str, Any]]:
    """The entry ``scores`` of ``metrics.json``: of each of ``GROUPS``, from the category of each query and its ``score_query``.

    ``accuracy`` is the share of queries that hit, ``mean_iou`` a plain mean over queries, as in LangSplat
    (docs/method.md#mean-iou); both with a ``clustered_interval``, and NaN without queries. ``random_pixel`` and
    ``middle_pixel`` are the accuracy of a random valid pixel and of the middle one (chance level).
    """
    summary = {}
    for name in GROUPS:
        asked = [category for category, score in zip(categories, scores, strict=True) if name in score]
        results = [score[name] for score in scores if name in score]
        hits = cluster([result.hit for result in results], asked)
        ious = cluster([result.iou for result in results], asked)
        summary[name] = {
            "count": len(results),
            "categories": len(hits.counts),
            "accuracy": hits.mean,
            "accuracy_interval": clustered_interval([hits]),
            "mean_iou": ious.mean,
            "mean_iou_interval": clustered_interval([ious]),
            "random_pixel": cluster([result.random_hit for result in results], asked).mean,
            "middle_pixel": cluster([result.middle_hit for result in results], asked).mean,
        }
    return summary


def target_area(layers: Ints32, instances: Sequence[int]) -> Bools:
    """(H, W) bool pixels of a (..., H, W) int32 map that hit any of the instances: those of its box, as in LangSplat's benchmark."""
    area = np.zeros(layers.shape[-2:], np.bool_)
    for x0, y0, x1, y1 in bounding_boxes(layers, instances):
        # The last column and row belong to the box.
        area[y0 : y1 + 1, x0 : x1 + 1] = True
    return area


def bounding_boxes(layers: Ints32, instances: Sequence[int]) -> Ints:
    """(B, 4) int64 boxes of the visible instances: first column and row, last column and row [px], all inside."""
    boxes = []
    for instance in instances:
        rows, columns = np.nonzero(mask_of(layers, [instance]))
        if len(rows):
            boxes.append((columns.min(), rows.min(), columns.max(), rows.max()))
    return np.array(boxes, np.int64).reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class AnsweredQuery:
    """A query with its scores by group, what ``count_right`` tells if masks are those of classes, and the answer of
    ``metrics.json``."""

    query: Query
    groups: Mapping[str, Result]
    right_pixels: int | None
    answer: dict[str, Any]


def run_queries(
    queries: Iterable[Query], ask: Ask, annotations: Artifact, valid: Bools, options: ScoringOptions
) -> Iterator[AnsweredQuery]:
    """Answer and score queries, frame by frame, because a frame is rendered once for all its queries."""
    instances, by_frame = instances_of(annotations), {}
    for query in queries:
        by_frame.setdefault(query.frame, []).append(query)
    for frame, in_frame in track(list(by_frame.items()), "queries"):
        layers = read_layers(annotations, in_frame[0].row, valid)
        answers = ask(frame, [query.category for query in in_frame])
        for query, answer in zip(in_frame, answers, strict=True):
            classes = options.masks == "classes"
            yield AnsweredQuery(
                query,
                score_query(query, answer.pixel, answer.mask, layers, valid),
                count_right(query, answer.mask, layers, instances) if classes else None,
                {
                    "relevancy": answer.score,
                    "level": answer.level,
                    "pixel": answer.pixel,
                    "position": None if answer.position is None else answer.position.tolist(),
                    "mask_level": answer.mask_level,
                    "mask_pixels": int(answer.mask.sum()),
                },
            )


def ask_of(evaluation: Evaluation, asker: Asker, masks: str = "threshold") -> Ask:
    """Ask a scene at the time of a frame, with the masks of ``metrics.masks``; the asker has the texts of ``phrases_to_ask``."""
    seconds = seconds_of(evaluation.frames_artifact)

    def ask(frame: int, phrases: Sequence[str]) -> Iterator[ViewMatch]:
        place = evaluation.camera_to_world[frame], evaluation.valid, float(seconds[frame])
        return asker.ask(phrases, evaluation.camera, Viewpoint(f"frame {frame}", *place))

    return mask_classes(ask, asker.texts.phrases) if masks == "classes" else ask


def mask_classes(ask: Ask, classes: Sequence[str]) -> Ask:
    """Give answers the masks of classes: the pixels where each is the most relevant one, the first of equal ones."""

    def ask_all(frame: int, phrases: Sequence[str]) -> Iterator[ViewMatch]:
        # Relevancy is 0 where nothing is visible, which is of no class.
        best, winner, kept = np.float32(0.0), np.int32(-1), {}
        for index, answer in enumerate(ask(frame, classes)):
            winner = np.where(answer.relevancy > best, np.int32(index), winner)
            best = np.where(answer.relevancy > best, answer.relevancy, best)
            if answer.phrase in phrases:
                kept[answer.phrase] = index, answer
        for phrase in phrases:
            index, answer = kept[phrase]
            yield replace(answer, mask=winner == index, mask_level=answer.level)

    return ask_all


def count_right(query: Query, mask: Bools, layers: Ints32, instances: Sequence[Instance]) -> int:
    """Number of pixels of a query's mask that are labeled with its category and no other."""
    same = np.array([instance.category == query.category for instance in instances])
    own, others = (mask_of(layers, np.flatnonzero(members).tolist()) for members in (same, ~same))
    return int((mask & own & ~others).sum())


def pixel_accuracy(answered: Sequence[AnsweredQuery], pixels: int) -> float | None:
    """Share of the pixels that show the scene whose class is right, mean over frames, 0..1; None without queries. Those without
    a label are wrong, as in 3D-OVS."""
    frames = {entry.query.frame for entry in answered}
    return sum(entry.right_pixels or 0 for entry in answered) / pixels / len(frames) if frames else None
