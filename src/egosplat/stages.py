"""The stages of the pipeline: where each one's function is, and what its result depends on."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from egosplat.fingerprint import code_hash


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    Attributes:
        module: the module whose function ``run`` makes the artifact.
        libraries: distributions whose version changes the result, beside egosplat itself.
        about: one line for the command line's help.
        models: keys of the configuration's section ``models`` that the stage takes beside its own section's.
        sections: other sections of the configuration whose keys it all takes as well.
    """

    module: str
    libraries: tuple[str, ...]
    about: str
    models: tuple[str, ...] = ()
    sections: tuple[str, ...] = ()


STAGES = {
    "synthetic": Stage(
        "egosplat.synthetic.stage",
        ("numpy", "opencv-contrib-python-headless", "scipy", "projectaria-tools"),
        "Make a synthetic apartment's recording in ADT's format.",
    ),
    "frames": Stage(
        "egosplat.frames.stage",
        ("numpy", "opencv-contrib-python-headless", "projectaria-tools", "zarr"),
        "Read a recording: rectified pictures and the train / evaluation split.",
    ),
    "annotations": Stage(
        "egosplat.frames.annotations_stage",
        ("numpy", "opencv-contrib-python-headless", "projectaria-tools", "zarr"),
        "Read a recording's instance maps at the evaluation frames (evaluation only).",
    ),
    "poses": Stage(
        "egosplat.poses.stage",
        ("numpy", "scipy", "pycolmap", "projectaria-tools", "zarr"),
        "Camera poses and points: the device's trajectory, or COLMAP.",
    ),
    "survey": Stage(
        "egosplat.survey.stage",
        ("jsonschema", "numpy", "opencv-contrib-python-headless", "scipy", "zarr"),
        "Find what a scene requires: does anything move, which frames add views.",
    ),
    "segments": Stage(
        "egosplat.segments.stage",
        ("numpy", "scipy", "opencv-contrib-python-headless", "torch", "torchvision", "sam2", "zarr"),
        "Find instances at three levels and follow them through the video.",
        ("sam2_config", "sam2_checkpoint", "device", "precision"),
    ),
    "view_features": Stage(
        "egosplat.features.view_features_stage",
        ("numpy", "open_clip_torch", "pillow", "scipy", "torch", "zarr"),
        "Encode the crop of each instance in each training frame with OpenCLIP.",
        models=("clip_checkpoint", "clip_model", "device", "precision"),
    ),
    "features": Stage(
        "egosplat.features.stage",
        ("numpy", "torch", "zarr"),
        "Aggregate each instance's features over its views, and compress them.",
    ),
    "transient": Stage(
        "egosplat.transient.stage",
        (
            "numpy",
            "opencv-contrib-python-headless",
            "scipy",
            "timm",
            "torch",
            "zarr",
        ),
        "Train a network to tell what moves, together with temporary Gaussians.",
    ),
    "masks": Stage(
        "egosplat.transient.masks_stage",
        ("numpy", "zarr"),
        "Find the instances that move, and mask them in every frame.",
    ),
    "splats": Stage(
        "egosplat.splats.stage",
        ("numpy", "scipy", "torch", "zarr"),
        "Train 3D Gaussians on the pictures.",
    ),
    "language": Stage(
        "egosplat.language.stage",
        ("numpy", "torch", "zarr"),
        "Give each Gaussian the codes of what it shows, at every level.",
    ),
    "metrics": Stage(
        "egosplat.benchmark.stage",
        (
            "jsonschema",
            "numpy",
            "open_clip_torch",
            "opencv-contrib-python-headless",
            "scipy",
            "torch",
            "zarr",
        ),
        "Ask for everything that is annotated, and score answers and renders.",
        models=("clip_checkpoint", "clip_model", "device", "precision"),
        sections=("query", "presence"),
    ),
    "method_metrics": Stage(
        "egosplat.benchmark.other_methods",
        (
            "jsonschema",
            "numpy",
            "opencv-contrib-python-headless",
            "scipy",
            "torch",
            "zarr",
        ),
        "Score another method's relevancy maps as egosplat's own.",
        sections=("metrics",),
    ),
    "contact_sheet": Stage(
        "egosplat.report.contact_sheet",
        ("matplotlib",),
        "Draw a scene's pictures, annotations, and its trajectory from above.",
    ),
    "language_sheet": Stage(
        "egosplat.report.language_sheet",
        ("matplotlib", "scipy", "torch"),
        "Look around in what the Gaussians mean, at each level.",
    ),
    "transient_sheet": Stage(
        "egosplat.report.transient_sheet",
        ("matplotlib", "torch"),
        "Draw what moves, what is masked for it, and what is left.",
    ),
    "crops_sheet": Stage(
        "egosplat.report.crops_sheet",
        ("matplotlib",),
        "Draw instances' crops in order of time, the views that were left out struck out.",
    ),
    "segments_sheet": Stage(
        "egosplat.report.segments_sheet",
        ("matplotlib",),
        "Draw the instances of each level in frames through the video.",
    ),
    "splats_sheet": Stage(
        "egosplat.report.splats_sheet",
        ("matplotlib",),
        "Draw how well held-out frames are rendered, and how training went.",
    ),
    "queries_sheet": Stage(
        "egosplat.report.queries_sheet",
        ("matplotlib", "open_clip_torch", "opencv-contrib-python-headless", "torch"),
        "Draw the queries that were answered best, and those that were answered worst.",
    ),
}


def stage_function(name: str) -> Callable[..., None]:
    """The function of a stage; imports its module, and only that."""
    return import_module(STAGES[name].module).run


def code_of(name: str) -> str:
    """Content hash of the code that a stage executes, with the versions of its libraries."""
    stage = STAGES[name]
    return code_hash(stage.module, stage.libraries)
