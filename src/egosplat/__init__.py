"""egosplat: ask questions in words of a 3D scene filmed from someone's head (docs/python.md)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from egosplat.errors import UserError as UserError
    from egosplat.evaluation.options import MetricsOptions as MetricsOptions
    from egosplat.export.scene import export_scene as export_scene
    from egosplat.features.options import FeaturesOptions as FeaturesOptions
    from egosplat.features.options import ViewFeaturesOptions as ViewFeaturesOptions
    from egosplat.frames.options import AnnotationsOptions as AnnotationsOptions
    from egosplat.frames.options import FramesOptions as FramesOptions
    from egosplat.instances.options import InstancesOptions as InstancesOptions
    from egosplat.language.options import LanguageOptions as LanguageOptions
    from egosplat.pipeline.running import run_stage as run_stage
    from egosplat.poses.options import PosesOptions as PosesOptions
    from egosplat.query.answers import Answer as Answer
    from egosplat.query.answers import Thing as Thing
    from egosplat.query.answers import ViewMatch as ViewMatch
    from egosplat.query.finished_scene import Scene as Scene
    from egosplat.query.finished_scene import open_scene as open_scene
    from egosplat.query.options import AskingOptions as AskingOptions
    from egosplat.rasterize.api import rasterization as rasterization
    from egosplat.segments.options import SegmentsOptions as SegmentsOptions
    from egosplat.splats.options import SplatsOptions as SplatsOptions
    from egosplat.survey.options import SurveyOptions as SurveyOptions
    from egosplat.transient.options import MasksOptions as MasksOptions
    from egosplat.transient.options import TransientOptions as TransientOptions

__version__ = "0.2.0"

# The public names by module. A module is imported on first use, so that ``import egosplat`` takes no time.
_MODULES = {
    "errors": ("UserError",),
    "evaluation.options": ("MetricsOptions",),
    "export.scene": ("export_scene",),
    "features.options": ("FeaturesOptions", "ViewFeaturesOptions"),
    "frames.options": ("AnnotationsOptions", "FramesOptions"),
    "instances.options": ("InstancesOptions",),
    "language.options": ("LanguageOptions",),
    "pipeline.running": ("run_stage",),
    "poses.options": ("PosesOptions",),
    "query.answers": ("Answer", "Thing", "ViewMatch"),
    "query.finished_scene": ("Scene", "open_scene"),
    "query.options": ("AskingOptions",),
    "rasterize.api": ("rasterization",),
    "segments.options": ("SegmentsOptions",),
    "splats.options": ("SplatsOptions",),
    "survey.options": ("SurveyOptions",),
    "transient.options": ("MasksOptions", "TransientOptions"),
}
_PLACES = {name: f"egosplat.{module}" for module, names in _MODULES.items() for name in names}

__all__ = ["__version__", *_PLACES]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Import a public name."""
    if name not in _PLACES:
        raise AttributeError(f"module 'egosplat' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
