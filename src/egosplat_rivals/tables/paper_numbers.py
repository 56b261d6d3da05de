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


@functools.cache
def printed_numbers() -> Mapping[tuple[str, ...], float]:
    """The printed numbers [%] by table, scene, line of its layout, metric and group."""
    table = _read("paper_numbers.csv", index_col=["table", "scene", "method", "metric"])
    return table.rename_axis(columns="group").stack().dropna().to_dict()


def _read(name: str, **more: Any) -> pd.DataFrame:
    with (resources.files("egosplat_rivals.tables") / name).open(encoding="utf-8") as file:
        return pd.read_csv(file, **more)


_SHORT = {"accuracy": "Acc", "mean_iou": "mIoU", "static": "St.", "dynamic": "Dy.", "all": "All"}
_METHOD_LINES = {method: (FULL if method == OWN else None, ()) for method in METHODS}


def _by_scene(name: str, score: str, metric: str) -> Layout:
    """A table with a column for each scene of ADT and group."""
    caption = f"{score} (%) on ADT, of static (St.), dynamic (Dy.) and all targets."
    places = {scene: f"scene {scene.removeprefix('scene')}" for scene in SCENES["adt"]} | {AVERAGE: "avg"}
    columns = tuple((scene, metric, group) for scene in places for group in GROUPS)
    headings = tuple((over, _SHORT[group]) for over in places.values() for group in GROUPS)
    return Layout(name, caption, "adt", SCENES["adt"], columns, headings, _METHOD_LINES)


def _ablation(
    name: str, caption: str, scenes: tuple[str, ...], lines: dict[str, str], components: tuple[str, str]
) -> Layout:
    """A table of EgoSplat's variants: without both components, with the first, and with both."""
    place = AVERAGE if scenes[1:] else scenes[0]
    columns = tuple((place, metric, group) for metric in METRICS for group in GROUPS)
    headings = tuple((f"{_SHORT[metric]} (%)", group.capitalize()) for metric in METRICS for group in GROUPS)
    steps = ((False, False), (True, False), (True, True))
    variants = {line: (lines[line], used) for line, used in zip(lines, steps, strict=True)}
    return Layout(name, caption, "adt", scenes, columns, headings, variants, components)


# The five tables, in the paper's order.
LAYOUTS = (
    _by_scene("adt_accuracy", "Localization accuracy", "accuracy"),
    _by_scene("adt_iou", "Segmentation IoU", "mean_iou"),
    _ablation(
        "adt_ablation",
        "Ablation on ADT, mean over scenes.",
        SCENES["adt"],
        {"baseline": "baseline", "aggregation": "no_masks", "full": FULL},
        ("Multi-view aggregation", "Transient prediction"),
    ),
    Layout(
        "hoi4d",
        "Localization accuracy and segmentation IoU (%) on HOI4D, mean over scenes.",
        "hoi4d",
        SCENES["hoi4d"],
        tuple((AVERAGE, metric, "all") for metric in METRICS),
        tuple(("", _SHORT[metric]) for metric in METRICS),
        _METHOD_LINES,
    ),
    _ablation(
        "adt_transient",
        "Ablation of the transient prediction on scene 1 of ADT.",
        ("scene1",),
        {"none": "no_masks", "initial": "network_masks", "refined": FULL},
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
    own = [
        one
        for one in LAYOUTS
        if one.dataset == scene.dataset and scene.scene in scenes_of(one, scene.validation)
    ]
    # Other methods have rows in all tables but ablations of EgoSplat.
    return any(scene.variant in one.variants if scene.method is None else not one.components for one in own)
