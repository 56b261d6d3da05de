"""The numbers that the paper prints (``paper_numbers.csv`` beside this file), and notes on them."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

import pandas as pd

METRICS = ("accuracy", "mean_iou")


AVERAGE = "average"
"""In place of a scene's name."""


METHODS = ("LERF", "LEGaussian", "SG", "GAGS", "LangSplat", "EgoSplat")
"""In the order of the paper's rows."""


SCENES = {dataset: tuple(f"scene{number}" for number in range(1, 6)) for dataset in ("adt", "hoi4d")}
"""The paper's five scenes of each dataset, as the table of scenes calls them."""


_KEY = ["table", "scene", "method", "metric", "group"]


@dataclass(frozen=True)
class PaperNote:
    """A remark on the paper's printed numbers.

    Attributes:
        text: the remark.
        cells: scene, method, metric and group of the printed numbers that it is about; none for the whole table.
    """

    text: str
    cells: tuple[tuple[str, str, str, str], ...] = ()


PAPER_NOTES: dict[str, tuple[PaperNote, ...]] = {
    "adt_accuracy": (
        PaperNote(
            "12.6 is below both 29.7 and 13.0; a score over the queries of both groups lies between them, but for "
            "the few queries that count in both. Probably a misprint.",
            (("scene1", "LERF", "accuracy", "all"),),
        ),
        PaperNote(
            "The mean of the five scenes is 23.5.",
            ((AVERAGE, "SG", "accuracy", "static"),),
        ),
        PaperNote(
            "Below LangSplat and GAGS, which the paper does not discuss.",
            (("scene4", "EgoSplat", "accuracy", "dynamic"),),
        ),
        PaperNote(
            "The paper tells neither its evaluation frames nor how many queries there are. Its numbers fit about 70 to "
            "160 pairs of a frame and a category in a scene, so that one pair is worth 0.5 to 1.5 points; many of SG's "
            "and GAGS's numbers fit no such count."
        ),
        PaperNote(
            "The paper's text cites this table under the label of the one of IoU, and the other way round; here "
            "captions are taken at their word."
        ),
    ),
    "adt_iou": (
        PaperNote(
            "The mean of the five scenes is 9.6.",
            ((AVERAGE, "SG", "mean_iou", "static"),),
        ),
        PaperNote(
            "The mean of the five scenes is 8.2.",
            ((AVERAGE, "SG", "mean_iou", "all"),),
        ),
    ),
    "adt_ablation": (
        PaperNote(
            "The numbers of LangSplat's row in the tables by scene.",
            tuple(
                (AVERAGE, "baseline", metric, group)
                for metric in ("accuracy", "mean_iou")
                for group in ("static", "dynamic", "all")
            ),
        ),
        PaperNote(
            "The transient prediction's gain on static targets is 1.3 points of accuracy and 0.5 of mIoU, with one pair "
            "of a frame and a category worth 0.5 to 1.5 points in a scene."
        ),
    ),
    "hoi4d": (
        PaperNote(
            "The printed numbers are of the paper's own annotations of the five sequences, with 37 categories, which are "
            "not public; egosplat reads the dataset's. How the paper averages is not told; egosplat takes the plain mean "
            "over scenes, as the paper's tables of ADT do."
        ),
    ),
    "adt_transient": (
        PaperNote(
            "The initial stage alone lowers mIoU, in every group, against no transient prediction at all.",
            tuple(("scene1", "initial", "mean_iou", group) for group in ("static", "dynamic", "all")),
        ),
        PaperNote(
            "The gain of both stages over none, 0.6 points of accuracy and 0.8 of mIoU, is that of one scene with "
            "100 to 300 pairs of a frame and a category: of accuracy, one to three pairs."
        ),
    ),
}
"""By the name of the table."""


def printed(table: str, scene: str, method: str, metric: str, group: str) -> float:
    """A printed number [%].

    Args:
        table: ``adt``, ``hoi4d``, ``adt-ablation`` or ``adt-transient``.
        scene: its name, or ``AVERAGE``.
        method: one of ``METHODS``; in the ablations ``baseline``, ``aggregation`` or ``full``, and ``none``,
            ``initial`` or ``refined``.
        metric: one of ``METRICS``.
        group: one of ``egosplat.evaluation.queries.GROUPS``.

    Raises:
        KeyError: the paper prints no such number.
    """
    return _numbers()[table, scene, method, metric, group]


@functools.cache
def _numbers() -> Mapping[tuple[str, ...], float]:
    text = resources.files("egosplat") / "tables" / "paper_numbers.csv"
    with text.open(encoding="utf-8") as file:
        table = pd.read_csv(file, keep_default_na=False)
    return table.set_index(_KEY)["percent"].to_dict()
