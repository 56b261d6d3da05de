"""The numbers printed in the paper (``paper_numbers.csv`` in this folder), and notes on them."""

import functools
from collections.abc import Mapping
from importlib import resources

import pandas as pd

from egosplat.evaluation.queries import GROUPS
from egosplat.evaluation.scored_scenes import FULL, VALIDATION, ScoredScene
from egosplat.evaluation.series import OWN
from egosplat_rivals.tables.table import AVERAGE, Layout, Note

METRICS = ("accuracy", "mean_iou")

# Methods in the order of the paper's rows.
METHODS = ("LERF", "LEGaussian", "SG", "GAGS", "LangSplat", "EgoSplat")

# The paper's five scenes of each dataset, as named in the table of scenes.
SCENES = {dataset: tuple(f"scene{number}" for number in range(1, 6)) for dataset in ("adt", "hoi4d")}

_KEY = ["table", "scene", "method", "metric"]


# Notes by the name of the table.
PAPER_NOTES: dict[str, tuple[Note, ...]] = {
    "adt_accuracy": (
        Note(
            "12.6 is below both 29.7 and 13.0. A score over the queries of both groups lies between their scores, "
            "except for the few queries that count in both. Probably a misprint.",
            (("scene1", "LERF", "accuracy", "all"),),
        ),
        Note("The mean of the five scenes is 23.5.", ((AVERAGE, "SG", "accuracy", "static"),)),
        Note(
            "Below LangSplat and GAGS; the paper does not discuss this.",
            (("scene4", "EgoSplat", "accuracy", "dynamic"),),
        ),
        Note(
            "The paper states neither its evaluation frames nor its number of queries. Its numbers are consistent with "
            "about 70 to 160 pairs of a frame and a category per scene, so that one pair is worth 0.5 to 1.5 points. "
            "Many numbers of SG and GAGS are consistent with no such count."
        ),
        Note(
            "The paper's text swaps the references to this table and to the table of IoU; the captions are used here."
        ),
    ),
    "adt_iou": (
        Note("The mean of the five scenes is 9.6.", ((AVERAGE, "SG", "mean_iou", "static"),)),
        Note("The mean of the five scenes is 8.2.", ((AVERAGE, "SG", "mean_iou", "all"),)),
    ),
    "adt_ablation": (
        Note(
            "Equal to LangSplat's row in the tables by scene. egosplat's baseline is given masks that hold in 3D; its row "
            "LangSplat in the other tables has the masks of single frames.",
            tuple((AVERAGE, "baseline", metric, group) for metric in METRICS for group in GROUPS),
        ),
        Note(
            "Transient prediction gains 1.3 points of accuracy and 0.5 points of mIoU on static targets; one pair of a "
            "frame and a category is worth 0.5 to 1.5 points in a scene."
        ),
    ),
    "hoi4d": (
        Note(
            "The paper uses its own annotations of the five sequences, with 37 categories, which are not public; "
            "egosplat reads the dataset's annotations. The paper does not state how it averages; egosplat uses the plain "
            "mean over scenes, as in the paper's tables of ADT."
        ),
    ),
    "adt_transient": (
        Note(
            "The initial stage alone lowers mIoU in every group, compared with no transient prediction.",
            tuple(("scene1", "initial", "mean_iou", group) for group in GROUPS),
        ),
        Note(
            "Both stages gain 0.6 points of accuracy and 0.8 points of mIoU over none, on one scene with 100 to 300 "
            "pairs of a frame and a category: in accuracy, one to three pairs."
        ),
    ),
}


def find_printed(table: str, scene: str, method: str, metric: str, group: str) -> float:
    """A printed number [%], by the ``numbers`` and a line of a layout; raises KeyError if the paper prints no such number."""
    return _numbers()[table, scene, method, metric, group]


@functools.cache
def _numbers() -> Mapping[tuple[str, ...], float]:
    with (resources.files(__package__) / "paper_numbers.csv").open(encoding="utf-8") as file:
        table = pd.read_csv(file, index_col=_KEY, na_filter=True)
    return table.rename_axis(columns="group").stack().dropna().to_dict()


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
