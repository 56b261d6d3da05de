"""The numbers that the paper prints, as ``paper_numbers.csv`` beside this file holds them."""

import functools
from collections.abc import Mapping
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
