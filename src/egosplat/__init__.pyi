"""Public names of egosplat; ``__init__.py`` imports each on first use."""

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
from egosplat.query.catalog import catalog as catalog
from egosplat.query.finished_scene import Scene as Scene
from egosplat.query.finished_scene import open_scene as open_scene
from egosplat.query.like import ask_pictures as ask_pictures
from egosplat.query.options import AskingOptions as AskingOptions
from egosplat.rasterize.api import rasterization as rasterization
from egosplat.segments.options import SegmentsOptions as SegmentsOptions
from egosplat.splats.options import SplatsOptions as SplatsOptions
from egosplat.survey.options import SurveyOptions as SurveyOptions
from egosplat.transient.options import MasksOptions as MasksOptions
from egosplat.transient.options import TransientOptions as TransientOptions

__version__: str
