"""The layouts of the paper's five tables."""

from dataclasses import dataclass

from egosplat.evaluation.queries import GROUPS
from egosplat.evaluation.scored_scenes import FULL, UNTOUCHED, ScoredScene
from egosplat.report.tables.paper_numbers import AVERAGE, METHODS, METRICS, SCENES
from egosplat.report.tables.series import OWN
from egosplat.report.tables.table import METRIC_NAMES, Column

_SHORT = {"static": "St.", "dynamic": "Dy.", "all": "All"}


@dataclass(frozen=True)
class Line:
    """A line of a table.

    Attributes:
        printed: name of the method in the paper's numbers.
        variant: the corresponding variant of EgoSplat; None for another method.
        steps: enabled components, in an ablation.
    """

    printed: str
    variant: str | None
    steps: tuple[bool, ...] = ()


@dataclass(frozen=True)
class Layout:
    """The layout of a table.

    Attributes:
        name: stem of the files.
        numbers: name of the table in the paper's numbers.
        dataset: dataset of the scenes.
        columns, lines: in the paper's order.
        components: column headings of an ablation's components.
    """

    name: str
    caption: str
    numbers: str
    dataset: str
    scenes: tuple[str, ...]
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    components: tuple[str, ...] = ()

    def scenes_of(self, untouched: bool) -> tuple[str, ...]:
        """The scenes of the table; untouched apartments appear only in averages."""
        if not untouched:
            return self.scenes
        averaged = any(column.scene == AVERAGE for column in self.columns)
        return UNTOUCHED if averaged and self.dataset == "adt" else ()


def _by_scene(metric: str) -> tuple[Column, ...]:
    headings = {scene: f"scene {scene.removeprefix('scene')}" for scene in SCENES["adt"]} | {AVERAGE: "avg"}
    return tuple(
        Column(scene, metric, group, over, _SHORT[group])
        for scene, over in headings.items()
        for group in GROUPS
    )


def _by_metric(scene: str) -> tuple[Column, ...]:
    return tuple(
        Column(scene, metric, group, f"{METRIC_NAMES[metric]} (%)", group.capitalize())
        for metric in METRICS
        for group in GROUPS
    )


_METHOD_LINES = tuple(Line(method, FULL if method == OWN else None) for method in METHODS)

# The five tables, in the paper's order.
LAYOUTS = (
    Layout(
        "adt_accuracy",
        "Localization accuracy (%) on ADT, of static (St.), dynamic (Dy.) and all targets.",
        "adt",
        "adt",
        SCENES["adt"],
        _by_scene("accuracy"),
        _METHOD_LINES,
    ),
    Layout(
        "adt_iou",
        "Segmentation IoU (%) on ADT, of static (St.), dynamic (Dy.) and all targets.",
        "adt",
        "adt",
        SCENES["adt"],
        _by_scene("mean_iou"),
        _METHOD_LINES,
    ),
    Layout(
        "adt_ablation",
        "Ablation on ADT, mean over scenes.",
        "adt-ablation",
        "adt",
        SCENES["adt"],
        _by_metric(AVERAGE),
        (
            Line("baseline", "baseline", (False, False)),
            Line("aggregation", "no_masks", (True, False)),
            Line("full", FULL, (True, True)),
        ),
        ("Multi-view aggregation", "Transient prediction"),
    ),
    Layout(
        "hoi4d",
        "Localization accuracy and segmentation IoU (%) on HOI4D, mean over scenes.",
        "hoi4d",
        "hoi4d",
        SCENES["hoi4d"],
        tuple(Column(AVERAGE, metric, "all", "", METRIC_NAMES[metric]) for metric in METRICS),
        _METHOD_LINES,
    ),
    Layout(
        "adt_transient",
        "Ablation of the transient prediction on scene 1 of ADT.",
        "adt-transient",
        "adt",
        ("scene1",),
        _by_metric("scene1"),
        (
            Line("none", "no_masks", (False, False)),
            Line("initial", "network_masks", (True, False)),
            Line("refined", FULL, (True, True)),
        ),
        ("Initial stage", "Refinement stage"),
    ),
)


def in_a_table(scene: ScoredScene) -> bool:
    """Whether any table shows a scene's scores."""
    return any(
        layout.dataset == scene.dataset
        and scene.scene in layout.scenes_of(scene.untouched)
        and _has_line(layout, scene)
        for layout in LAYOUTS
    )


def _has_line(layout: Layout, scene: ScoredScene) -> bool:
    """Whether a table has a line for a scene's variant, or a row for another method: an ablation of EgoSplat has none."""
    if scene.method is not None:
        return not layout.components
    return scene.variant in {line.variant for line in layout.lines}
