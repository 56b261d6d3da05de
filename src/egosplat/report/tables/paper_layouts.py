"""The layouts of the paper's five tables."""

from egosplat.evaluation.queries import GROUPS
from egosplat.evaluation.scored_scenes import FULL, VALIDATION, ScoredScene
from egosplat.report.tables.paper_numbers import METHODS, METRICS, SCENES
from egosplat.report.tables.series import OWN
from egosplat.report.tables.table import AVERAGE, Layout

_METRIC_NAMES = {"accuracy": "Acc", "mean_iou": "mIoU"}
_BY_METRIC = tuple(
    (f"{_METRIC_NAMES[metric]} (%)", group.capitalize()) for metric in METRICS for group in GROUPS
)
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


def _columns(scene: str) -> tuple[tuple[str, str, str], ...]:
    return tuple((scene, metric, group) for metric in METRICS for group in GROUPS)


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
        _columns(AVERAGE),
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
        _columns("scene1"),
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
        and _has_line(layout, scene)
        for layout in LAYOUTS
    )


def _has_line(layout: Layout, scene: ScoredScene) -> bool:
    """Whether a table has a line for a scene's variant, or a row for another method: an ablation of EgoSplat has none."""
    if scene.method is not None:
        return not layout.components
    return scene.variant in {variant for variant, _ in layout.lines.values()}
