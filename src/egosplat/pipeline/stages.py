"""The table of stages: the one place that says what a stage runs, reads, writes and depends on.

The command line, the checks, the sharing between variants and the rules' paths come from ``STAGES``. The types, defaults and
descriptions of a stage's keys stand in ``config.schema.yaml``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from inspect import signature
from typing import Any

from egosplat.pipeline.code_hash import code_hash


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    Attributes:
        name: of the stage, and of the configuration's section with its keys, if it has any.
        module: its function ``run`` writes the output.
        help: one line for the command line.
        output: file or folder that it writes, as it is called in the scene's folder.
        inputs: what it always reads: names of other stages, whose outputs they are, or of ``PATHS``.
        optional: what some configurations let it read, by name of the stage, and when that is.
        libraries: distributions whose version changes the output.
        sections: other sections of the configuration, all keys of which the stage takes.
        keys: some keys of yet other sections, by section.
        scene: what it takes from the scene: ``format`` of the recording, ``title`` for pages.
    """

    name: str
    module: str
    help: str
    output: str
    inputs: tuple[str, ...] = ()
    optional: Mapping[str, str] = field(default_factory=dict)
    libraries: tuple[str, ...] = ()
    sections: tuple[str, ...] = ()
    keys: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    scene: tuple[str, ...] = ()

    @property
    def models(self) -> tuple[str, ...]:
        """The keys of the section ``models`` that the stage takes."""
        return self.keys.get("models", ())


PATHS = {
    "recording": "the recording's folder or video file",
    "relevancy": "the other method's relevancy maps, laid out as docs/other_methods.md says",
}
"""Inputs that no stage writes under their name."""

_TRAINING_FRAMES = {"survey": "to train on frames that add views alone"}
_MASKING = {
    "transient": "where splats.masking is initial",
    "masks": "where splats.masking is refined",
}
_JOINT = {
    "segments": "where splats.language is joint",
    "features": "where splats.language is joint",
}
_CLIP = {"models": ("clip_checkpoint", "clip_model", "device", "precision")}
_SAM2 = {"models": ("sam2_config", "sam2_checkpoint", "device", "precision")}

_STAGES = (
    Stage(
        "synthetic",
        "egosplat.synthetic.stage",
        "Make the recording of a synthetic apartment, in ADT's format.",
        output="recording",
        libraries=("numpy", "opencv-contrib-python-headless", "scipy", "projectaria-tools"),
    ),
    Stage(
        "frames",
        "egosplat.frames.stage",
        "Read a recording: rectified frames, and their split into training and evaluation.",
        output="frames.zarr",
        inputs=("recording",),
        libraries=("numpy", "opencv-contrib-python-headless", "projectaria-tools", "zarr"),
        scene=("format",),
    ),
    Stage(
        "annotations",
        "egosplat.frames.annotations_stage",
        "Read a recording's instance maps at the evaluation frames (for evaluation only).",
        output="annotations.zarr",
        inputs=("recording", "frames"),
        libraries=("numpy", "opencv-contrib-python-headless", "projectaria-tools", "zarr"),
    ),
    Stage(
        "poses",
        "egosplat.poses.stage",
        "Find camera poses and points: from the device's trajectory, or with COLMAP.",
        output="poses.zarr",
        inputs=("recording", "frames"),
        libraries=("numpy", "scipy", "pycolmap", "projectaria-tools", "zarr"),
    ),
    Stage(
        "survey",
        "egosplat.survey.stage",
        "Find what a scene requires: whether anything moves, and which frames add views.",
        output="survey.json",
        inputs=("frames", "poses"),
        libraries=("jsonschema", "numpy", "opencv-contrib-python-headless", "scipy", "zarr"),
    ),
    Stage(
        "segments",
        "egosplat.segments.stage",
        "Find instances at three levels, and track them through the video.",
        output="segments.zarr",
        inputs=("frames",),
        optional=_TRAINING_FRAMES,
        libraries=(
            "numpy",
            "scipy",
            "opencv-contrib-python-headless",
            "torch",
            "torchvision",
            "sam2",
            "zarr",
        ),
        keys=_SAM2,
    ),
    Stage(
        "view_features",
        "egosplat.features.view_features_stage",
        "Encode the crop of each instance in each training frame with OpenCLIP.",
        output="view_features.zarr",
        inputs=("frames", "segments"),
        libraries=("numpy", "open_clip_torch", "pillow", "scipy", "torch", "zarr"),
        keys=_CLIP,
    ),
    Stage(
        "features",
        "egosplat.features.stage",
        "Aggregate the features of each instance over its views, and compress them.",
        output="features.zarr",
        inputs=("view_features",),
        libraries=("numpy", "torch", "zarr"),
    ),
    Stage(
        "transient",
        "egosplat.transient.stage",
        "Train a network to tell what moves, together with temporary Gaussians.",
        output="transient.zarr",
        inputs=("frames", "poses"),
        optional=_TRAINING_FRAMES,
        libraries=("numpy", "opencv-contrib-python-headless", "scipy", "timm", "torch", "zarr"),
    ),
    Stage(
        "masks",
        "egosplat.transient.masks_stage",
        "Find the instances that move, and mask them in every frame.",
        output="masks.zarr",
        inputs=("frames", "transient", "segments"),
        libraries=("numpy", "zarr"),
    ),
    Stage(
        "splats",
        "egosplat.splats.stage",
        "Train 3D Gaussians on the frames.",
        output="splats.zarr",
        inputs=("frames", "poses"),
        optional=_TRAINING_FRAMES | _MASKING | _JOINT,
        libraries=("numpy", "scipy", "torch", "zarr"),
    ),
    Stage(
        "language",
        "egosplat.language.stage",
        "Give each Gaussian the codes of the instance that it shows, at every level.",
        output="language.zarr",
        inputs=("frames", "poses", "segments", "features", "splats"),
        optional=_TRAINING_FRAMES | _MASKING,
        libraries=("numpy", "torch", "zarr"),
    ),
    Stage(
        "metrics",
        "egosplat.evaluation.stage",
        "Query everything that is annotated, and score the answers and the renders.",
        output="metrics.json",
        inputs=("frames", "poses", "annotations", "features", "splats", "language"),
        libraries=(
            "jsonschema",
            "numpy",
            "open_clip_torch",
            "opencv-contrib-python-headless",
            "scipy",
            "torch",
            "zarr",
        ),
        sections=("query", "presence"),
        keys=_CLIP,
        scene=("title",),
    ),
    Stage(
        "method_metrics",
        "egosplat.evaluation.external",
        "Score another method's relevancy maps as egosplat's own.",
        output="method_metrics.json",
        inputs=("frames", "poses", "annotations", "relevancy"),
        libraries=("jsonschema", "numpy", "opencv-contrib-python-headless", "scipy", "torch", "zarr"),
        sections=("metrics",),
        # The other keys of the section are of egosplat's own maps.
        keys={"query": ("box_filter", "segmentation_threshold", "majority_filter")},
        scene=("title",),
    ),
    Stage(
        "contact_sheet",
        "egosplat.report.contact_sheet",
        "Draw a scene's frames, annotations, and its trajectory from above.",
        output="contact_sheet.png",
        inputs=("frames", "annotations", "poses"),
        libraries=("matplotlib",),
        scene=("title",),
    ),
    Stage(
        "language_sheet",
        "egosplat.report.language_sheet",
        "Draw the meaning of the Gaussians from several sides, at each level.",
        output="language.png",
        inputs=("poses", "splats", "language"),
        libraries=("matplotlib", "scipy", "torch"),
        scene=("title",),
    ),
    Stage(
        "transient_sheet",
        "egosplat.report.transient_sheet",
        "Draw what moves, what is masked for it, and what is left.",
        output="transient.png",
        inputs=("frames", "poses", "transient", "segments", "masks", "splats"),
        libraries=("matplotlib", "torch"),
        scene=("title",),
    ),
    Stage(
        "crops_sheet",
        "egosplat.report.crops_sheet",
        "Draw the crops of instances in order of time, with outlier views struck out.",
        output="crops.png",
        inputs=("frames", "segments", "view_features", "features"),
        libraries=("matplotlib",),
        scene=("title",),
    ),
    Stage(
        "segments_sheet",
        "egosplat.report.segments_sheet",
        "Draw the instances of each level in frames through the video.",
        output="segments.png",
        inputs=("frames", "segments"),
        libraries=("matplotlib",),
        scene=("title",),
    ),
    Stage(
        "splats_sheet",
        "egosplat.report.splats_sheet",
        "Draw how well held-out frames are rendered, and the curves of the training.",
        output="splats.png",
        inputs=("frames", "splats"),
        libraries=("matplotlib",),
        scene=("title",),
    ),
    Stage(
        "queries_sheet",
        "egosplat.report.queries_sheet",
        "Draw the queries with the best and the worst answers.",
        output="queries.png",
        inputs=("frames", "poses", "annotations", "features", "splats", "language", "metrics"),
        libraries=("matplotlib", "open_clip_torch", "opencv-contrib-python-headless", "torch"),
        scene=("title",),
    ),
)

STAGES = {stage.name: stage for stage in _STAGES}
"""The stages by name, in the order of the pipeline."""

ARTIFACTS = tuple(name for name, stage in STAGES.items() if stage.output.endswith(".zarr"))
"""The stages that write an artifact, in the order of the pipeline."""

PAGES = tuple(name for name, stage in STAGES.items() if stage.output.endswith(".png"))
"""The stages that draw a page."""

PIPELINE = tuple(name for name in STAGES if name not in (*PAGES, "method_metrics"))
"""The stages from a scene's recording to its scores."""


def path_help(stage: Stage) -> dict[str, str]:
    """One line about each path that a stage takes, by name: its inputs, optional ones after, and ``output``."""
    inputs = {name: PATHS.get(name) or f"the scene's {STAGES[name].output}" for name in stage.inputs}
    optional = {name: f"the scene's {STAGES[name].output}, {when}" for name, when in stage.optional.items()}
    return inputs | optional | {"output": f"where to write {stage.output}"}


def stage_function(name: str) -> Callable[..., None]:
    """The function of a stage; imports its module, and only that."""
    return import_module(STAGES[name].module).run


def options_of(name: str) -> type | None:
    """The dataclass of a stage's keys, which its function takes as ``options``; None of a stage without keys."""
    parameter = signature(stage_function(name)).parameters.get("options")
    return parameter and parameter.annotation


def run_stage(name: str, keys: Mapping[str, Any], **given: Any) -> None:
    """Run a stage.

    Args:
        name: of the stage.
        keys: the values of its keys of the configuration, by name; none for a stage without keys.
        given: its paths and what it takes from the scene, by name.
    """
    options = options_of(name)
    stage_function(name)(**given, **({"options": options(**keys)} if options else {}))


def code_of(name: str) -> str:
    """Content hash of the code that a stage executes, with the versions of its libraries."""
    stage = STAGES[name]
    return code_hash(stage.module, stage.libraries)
