"""The numbers printed in the paper (``paper_numbers.csv`` in this folder), and notes on them (``paper_notes.csv``)."""

import functools
from collections.abc import Mapping
from importlib import resources
from itertools import product
from typing import Any

import pandas as pd

from egosplat.evaluation.queries import GROUPS
from egosplat_rivals.scored_scenes import FULL, OWN, VALIDATION, ScoredScene
from egosplat_rivals.tables.table import AVERAGE, Layout, Note

METRICS = ("accuracy", "mean_iou")

# Methods in the order of the paper's rows.
METHODS = ("LERF", "LEGaussian", "SG", "GAGS", "LangSplat", "EgoSplat")

# The paper's five scenes of each dataset, as named in the table of scenes.
SCENES = {dataset: tuple(f"scene{number}" for number in range(1, 6)) for dataset in ("adt", "hoi4d")}


def find_notes(table: str) -> list[Note]:
    """The notes on a table; a cell of ``paper_notes.csv`` may name several metrics and groups."""
    rows = _read("paper_notes.csv", keep_default_na=False)
    return [
        Note(
            row.text, tuple(product(*(row[name].split() for name in ("scene", "method", "metric", "group"))))
        )
        for _, row in rows[rows.table == table].iterrows()
    ]


def find_printed(table: str, scene: str, method: str, metric: str, group: str) -> float:
    """A printed number [%], by the ``numbers`` and a line of a layout; raises KeyError if the paper prints no such number."""
    return _numbers()[table, scene, method, metric, group]


@functools.cache
def _numbers() -> Mapping[tuple[str, ...], float]:
    table = _read("paper_numbers.csv", index_col=["table", "scene", "method", "metric"])
    return table.rename_axis(columns="group").stack().dropna().to_dict()


def _read(name: str, **more: Any) -> pd.DataFrame:
    with (resources.files("egosplat_rivals.tables") / name).open(encoding="utf-8") as file:
        return pd.read_csv(file, **more)


_METRIC_NAMES = {"accuracy": "Acc", "mean_iou": "mIoU"}
_BY_METRIC = tuple((f"{_METRIC_NAMES[one]} (%)", group.capitalize()) for one in METRICS for group in GROUPS)
_METHOD_LINES = {method: (FULL if method == OWN else None, ()) for method in METHODS}


def _by_scene(name: str, score: str, metric: str) -> Layout:
    """A table with a column for each scene of ADT and group."""
    headings = {scene: f"scene {scene.removeprefix('scene')}" for scene in SCENES["adt"]} | {AVERAGE: "avg"}
    short = {"static": "St.", "dynamic": "Dy.", "all": "All"}
    return Layout(
        name,
        f"{score} (%) on ADT, of static (St.), dynamic (Dy.) and all targets.",
        "adt",
        "adt",
        SCENES["adt"],
        tuple((scene, metric, group) for scene in headings for group in GROUPS),
        tuple((over, short[group]) for over in headings.values() for group in GROUPS),
        _METHOD_LINES,
    )


# The five tables, in the paper's order.
LAYOUTS = (
    _by_scene("adt_accuracy", "Localization accuracy", "accuracy"),
    _by_scene("adt_iou", "Segmentation IoU", "mean_iou"),
    Layout(
        "adt_ablation",
        "Ablation on ADT, mean over scenes.",
        "adt-ablation",
        "adt",
        SCENES["adt"],
        tuple((AVERAGE, metric, group) for metric in METRICS for group in GROUPS),
        _BY_METRIC,
        {
            "baseline": ("baseline", (False, False)),
            "aggregation": ("no_masks", (True, False)),
            "full": (FULL, (True, True)),
        },
        ("Multi-view aggregation", "Transient prediction"),
    ),
    Layout(
        "hoi4d",
        "Localization accuracy and segmentation IoU (%) on HOI4D, mean over scenes.",
        "hoi4d",
        "hoi4d",
        SCENES["hoi4d"],
        tuple((AVERAGE, metric, "all") for metric in METRICS),
        tuple(("", _METRIC_NAMES[metric]) for metric in METRICS),
        _METHOD_LINES,
    ),
    Layout(
        "adt_transient",
        "Ablation of the transient prediction on scene 1 of ADT.",
        "adt-transient",
        "adt",
        ("scene1",),
        tuple(("scene1", metric, group) for metric in METRICS for group in GROUPS),
        _BY_METRIC,
        {
            "none": ("no_masks", (False, False)),
            "initial": ("network_masks", (True, False)),
            "refined": (FULL, (True, True)),
        },
        ("Initial stage", "Refinement stage"),
    ),
)


def scenes_of(layout: Layout, validation: bool) -> tuple[str, ...]:
    """The scenes of a table; validation apartments appear only in averages."""
    if not validation:
        return layout.scenes
    averaged = any(scene == AVERAGE for scene, _, _ in layout.columns)
    return VALIDATION if averaged and layout.dataset == "adt" else ()


def in_a_table(scene: ScoredScene) -> bool:
    """Whether any table shows a scene's scores."""
    return any(
        layout.dataset == scene.dataset
        and scene.scene in scenes_of(layout, scene.validation)
        # Other methods have rows in all tables but ablations of EgoSplat.
        and (
            scene.variant in {one for one, _ in layout.lines.values()}
            if scene.method is None
            else not layout.components
        )
        for layout in LAYOUTS
    )
