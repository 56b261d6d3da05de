"""The table of stages: code, inputs, outputs and dependencies of each stage.

The command line, the checks, the sharing between variants and the rules' paths use ``STAGES``. A stage's keys
are the fields of its class of options.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from egosplat.errors import UserError
from egosplat.pipeline.code_hash import code_hash

if TYPE_CHECKING:
    from egosplat.pipeline.options import Options


@dataclass(frozen=True)
class Choice:
    """Modules of which a stage loads one, by a value; only that one is a part of its code.

    Attributes:
        by: what the value is, for errors; ``variants.chosen_value`` gets the value of a scene.
        modules: names of modules by value.
    """

    by: str
    modules: Mapping[str, str]

    def find(self, value: str) -> str:
        """Get the name of the module of a value (UserError: the value has none)."""
        if value not in self.modules:
            raise UserError(f"{self.by}: {value!r} is unknown; choose from {', '.join(self.modules)}.")
        return self.modules[value]


def by(what: str, **modules: str) -> Choice:
    """A ``Choice`` among modules of the package, by value."""
    return Choice(what, {value: f"egosplat.{name}" for value, name in modules.items()})


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    Attributes:
        name: name of the stage and of its configuration section, if it has keys.
        module: module whose function ``run`` writes the output.
        help: one-line help of its command.
        output: name of the file or folder that it writes in the scene's folder.
        inputs: inputs that it always reads: names of stages (their outputs) or of ``PATHS``.
        optional: inputs that some configurations need, with the condition as text, by name of the stage.
        libraries: distributions whose version changes the output.
        options: class of its options, MODULE:CLASS; empty for a stage without keys.
        scene: values that it takes from the table of scenes and the variant: ``format`` of the recording, ``title`` for
            pages, ``method``, the published method that a variant stands for, and what ``metrics.json`` tells of the
            configuration: ``preset``, and ``world_seed`` and ``camera`` of a synthetic apartment.
        modules: modules of which it loads one with ``load_module``.
        by_chunks: whether jobs can work on chunks of its frames. ``run`` takes ``chunk`` and ``gather`` then, see ``Work``.
    """

    name: str
    module: str
    help: str
    output: str
    inputs: tuple[str, ...] = ()
    optional: Mapping[str, str] = field(default_factory=dict)
    libraries: tuple[str, ...] = ()
    options: str = ""
    scene: tuple[str, ...] = ()
    modules: Choice | None = None
    by_chunks: bool = False


# Inputs that no stage writes under this name.
PATHS = {
    "recording": "the recording's folder or video file",
    "relevancy": "the other method's relevancy maps in the layout of docs/methods.md",
}

_TRAINING_FRAMES = {"survey": "to train only on frames that add views"}
_MASKING = {"transient": "if splats.masking is initial", "masks": "if splats.masking is refined"}
_MOVING = {"transient": "to track what moves: if segments.prompting is each_frame"}
_GIVEN = {"splats": "to merge masks on: if splats.source is given, or nothing is masked or tracked"}
_PROMPTS = {"prompts": "if segments.point_prompts is depth"}
_JOINT = dict.fromkeys(("instances", "features"), "if splats.language is joint")
_LEARNT_FROM = {
    **dict.fromkeys(("instances", "features"), "unless language.method is field or quantized"),
    "tiles": "if language.method is field or quantized",
}
_RESTING = {"rests": "if what moves is tracked and language.method is lifted"}
_OPENCV = "opencv-contrib-python-headless"
_SETUP = ("preset", "world_seed", "camera")
_ENCODED = {name: _LEARNT_FROM[name] for name in ("features", "tiles")}


def _sheet(
    name: str, about: str, output: str, inputs: tuple[str, ...], libraries: tuple[str, ...] = (), **more: Any
) -> Stage:
    """A stage that draws a sheet of a scene."""
    module, libraries = f"egosplat.report.sheets.{name}", ("matplotlib", *libraries)
    return Stage(name, module, about, output, inputs, libraries=libraries, scene=("title",), **more)


_STAGES = (
    Stage(
        "synthetic",
        "egosplat_apartments.stage",
        "Make the recording of a synthetic apartment.",
        options="egosplat_apartments.options:SyntheticOptions",
        output="recording",
        libraries=("numpy", _OPENCV, "scipy", "projectaria-tools"),
    ),
    Stage(
        "frames",
        "egosplat.frames.stage",
        "Read and rectify frames, and choose those to evaluate.",
        options="egosplat.frames.options:FramesOptions",
        output="frames.zarr",
        inputs=("recording",),
        libraries=("numpy", _OPENCV, "projectaria-tools", "pycolmap", "zarr"),
        scene=("format",),
        modules=by(
            "format",
            adt="frames.adt",
            hoi4d="frames.hoi4d",
            plain="frames.pictures",
            lerf="frames.lerf",
            **{"3d_ovs": "frames.ovs"},
        ),
    ),
    Stage(
        "annotations",
        "egosplat.frames.annotations_stage",
        "Read the instance maps of the evaluation frames.",
        options="egosplat.frames.options:AnnotationsOptions",
        output="annotations.zarr",
        inputs=("recording", "frames"),
        libraries=("numpy", _OPENCV, "projectaria-tools", "zarr"),
        modules=by(
            "format",
            adt="frames.adt_annotations",
            hoi4d="frames.hoi4d_annotations",
            plain="frames.plain_annotations",
            lerf="frames.lerf_annotations",
            **{"3d_ovs": "frames.ovs_annotations"},
        ),
    ),
    Stage(
        "poses",
        "egosplat.poses.stage",
        "Get camera poses: from the device, a file, or COLMAP.",
        options="egosplat.poses.options:PosesOptions",
        output="poses.zarr",
        inputs=("recording", "frames"),
        libraries=("numpy", "scipy", "pycolmap", "projectaria-tools", "zarr"),
        modules=by("poses.method", device="poses.adt", known="poses.known", colmap="poses.colmap"),
    ),
    Stage(
        "survey",
        "egosplat.survey.stage",
        "Decide if a scene is static and which frames add views.",
        options="egosplat.survey.options:SurveyOptions",
        output="survey.json",
        inputs=("frames", "poses"),
        libraries=("jsonschema", "numpy", _OPENCV, "scipy", "zarr"),
    ),
    Stage(
        "transient",
        "egosplat.transient.stage",
        "Train a network that predicts moving pixels.",
        options="egosplat.transient.options:TransientOptions",
        output="transient.zarr",
        inputs=("frames", "poses"),
        optional=_TRAINING_FRAMES,
        libraries=("numpy", _OPENCV, "scipy", "timm", "torch", "zarr"),
    ),
    Stage(
        "segments",
        "egosplat.segments.stage",
        "Find instances at three levels in the frames.",
        options="egosplat.segments.options:SegmentsOptions",
        output="segments.zarr",
        inputs=("frames",),
        optional=_TRAINING_FRAMES | _MOVING | _PROMPTS,
        libraries=("numpy", "scipy", _OPENCV, "torch", "torchvision", "sam2", "zarr"),
        by_chunks=True,
    ),
    Stage(
        "instances",
        "egosplat.instances.stage",
        "Merge masks into instances that hold in 3D.",
        options="egosplat.instances.options:InstancesOptions",
        output="instances.zarr",
        inputs=("frames", "poses", "segments"),
        optional=_TRAINING_FRAMES | _GIVEN,
        libraries=("numpy", _OPENCV, "scipy", "torch", "zarr"),
    ),
    Stage(
        "view_features",
        "egosplat.features.view_features_stage",
        "Encode the crops of each instance with OpenCLIP.",
        options="egosplat.features.options:ViewFeaturesOptions",
        output="view_features.zarr",
        inputs=("frames", "instances"),
        libraries=("numpy", "open_clip_torch", "pillow", "scipy", "torch", "zarr"),
        by_chunks=True,
    ),
    Stage(
        "features",
        "egosplat.features.stage",
        "Aggregate the features of each instance over its views.",
        options="egosplat.features.options:FeaturesOptions",
        output="features.zarr",
        inputs=("view_features",),
        libraries=("numpy", "torch", "zarr"),
    ),
    Stage(
        "masks",
        "egosplat.transient.masks_stage",
        "Mask what moves in every frame.",
        options="egosplat.transient.options:MasksOptions",
        output="masks.zarr",
        inputs=("frames", "transient", "instances"),
        libraries=("numpy", "zarr"),
    ),
    Stage(
        "splats",
        "egosplat.splats.stage",
        "Train 3D Gaussians on the frames, or read them.",
        options="egosplat.splats.options:SplatsOptions",
        output="splats.zarr",
        inputs=("frames", "poses"),
        optional=_TRAINING_FRAMES | _MASKING | _JOINT,
        libraries=("numpy", "scipy", "torch", "zarr"),
    ),
    Stage(
        "tiles",
        "egosplat.baselines.tiles_stage",
        "Encode tiles of the frames, for methods of others.",
        options="egosplat.baselines.options:TilesOptions",
        output="tiles.zarr",
        inputs=("frames",),
        optional=_TRAINING_FRAMES,
        libraries=("numpy", "open_clip_torch", "pillow", "torch", "torchvision", "sam2", "zarr"),
        by_chunks=True,
    ),
    Stage(
        "prompts",
        "egosplat.baselines.depth_prompts_stage",
        "Place point prompts by depth, for a method of others.",
        options="egosplat.baselines.options:PromptsOptions",
        output="prompts.zarr",
        inputs=("frames", "poses", "splats"),
        optional=_TRAINING_FRAMES,
        libraries=("numpy", "torch", "zarr"),
    ),
    Stage(
        "language",
        "egosplat.language.stage",
        "Assign each Gaussian the code of its instance.",
        options="egosplat.language.options:LanguageOptions",
        output="language.zarr",
        inputs=("frames", "poses", "splats"),
        optional=_TRAINING_FRAMES | _MASKING | _LEARNT_FROM,
        libraries=("numpy", "scipy", "torch", "zarr"),
        modules=by(
            "language.method",
            joint="language.joint",
            lifted="language.dominant",
            trained="language.training",
            projected="baselines.semantic_gaussians",
            center="baselines.occam",
            clustered="baselines.splat_feature_solver",
            sparse="baselines.langsplat_v2",
            granular="baselines.gags",
            field="baselines.lerf",
            quantized="baselines.legaussians",
        ),
    ),
    Stage(
        "carries",
        "egosplat.carries.stage",
        "Find what is carried from where to where.",
        options="egosplat.carries.options:CarriesOptions",
        output="carries.zarr",
        inputs=("frames", "poses", "instances", "view_features", "splats"),
        libraries=("numpy", _OPENCV, "torch", "zarr"),
    ),
    Stage(
        "rests",
        "egosplat.rests.stage",
        "Train Gaussians of what lies somewhere for a while.",
        options="egosplat.rests.options:RestsOptions",
        output="rests.zarr",
        inputs=("frames", "poses", "instances", "view_features", "splats", "carries"),
        optional={"masks": _MASKING["masks"]},
        libraries=("numpy", "open_clip_torch", _OPENCV, "scipy", "torch", "zarr"),
    ),
    Stage(
        "metrics",
        "egosplat.evaluation.stage",
        "Query every annotated category, and score the answers.",
        options="egosplat.evaluation.options:MetricsOptions",
        output="metrics.json",
        inputs=("frames", "poses", "annotations", "splats", "language"),
        optional=_ENCODED | _RESTING,
        libraries=("jsonschema", "numpy", "open_clip_torch", _OPENCV, "scipy", "torch", "zarr"),
        scene=("title", "method", *_SETUP),
    ),
    Stage(
        "method_metrics",
        "egosplat.baselines.external_maps",
        "Score another method's relevancy maps like egosplat's own.",
        options="egosplat.baselines.options:MethodMetricsOptions",
        output="method_metrics.json",
        inputs=("frames", "poses", "annotations", "relevancy"),
        libraries=("jsonschema", "numpy", _OPENCV, "scipy", "torch", "zarr"),
        scene=("title", *_SETUP),
    ),
    _sheet(
        "contact_sheet",
        "Draw a scene's frames, annotations and trajectory.",
        "contact_sheet.png",
        ("frames", "annotations", "poses"),
        libraries=("adjustText",),
    ),
    _sheet(
        "language_sheet",
        "Draw the Gaussians' codes from several directions.",
        "language.png",
        ("poses", "splats", "language"),
        libraries=(
            "scipy",
            "torch",
        ),
    ),
    _sheet(
        "transient_sheet",
        "Draw what moves, its masks, and renders without it.",
        "transient.png",
        ("frames", "poses", "transient", "instances", "masks", "splats"),
        libraries=(
            "adjustText",
            "torch",
        ),
    ),
    _sheet(
        "carries_sheet",
        "Draw what is carried from where to where, and when.",
        "carries.png",
        ("frames", "poses", "splats", "carries"),
        libraries=("adjustText",),
    ),
    _sheet(
        "crops_sheet",
        "Draw the crops of instances, with outliers crossed out.",
        "crops.png",
        ("frames", "instances", "view_features", "features"),
    ),
    _sheet(
        "instances_sheet",
        "Draw the instances of each level in frames and from above.",
        "instances.png",
        ("frames", "poses", "segments", "instances"),
    ),
    _sheet(
        "splats_sheet",
        "Draw held-out frames next to their renders.",
        "splats.png",
        ("frames", "splats"),
    ),
    _sheet(
        "queries_sheet",
        "Draw the queries with the best and the worst answers.",
        "queries.png",
        ("frames", "poses", "annotations", "splats", "language", "metrics"),
        optional=_ENCODED | _RESTING,
        libraries=(
            "open_clip_torch",
            _OPENCV,
            "torch",
        ),
    ),
    Stage(
        "scene_page",
        "egosplat.viewing.stage",
        "Write the scene as one HTML file that can be asked.",
        options="egosplat.viewing.options:ScenePageOptions",
        output="scene.html",
        inputs=("frames", "poses", "instances", "features", "splats", "language"),
        optional={"carries": _RESTING["rests"], **_RESTING},
        libraries=("open_clip_torch", _OPENCV, "torch"),
        scene=("title",),
    ),
)

# Stages by name, in the order of the pipeline.
STAGES = {stage.name: stage for stage in _STAGES}

# The stages that write an artifact, in the order of the pipeline.
ARTIFACTS = tuple(name for name, stage in STAGES.items() if stage.output.endswith(".zarr"))

# The stages that write one file, by default under the name ``output``.
FILES = tuple(name for name, stage in STAGES.items() if stage.output.endswith((".json", ".png", ".html")))

# The stages that draw a page.
PAGES = tuple(name for name, stage in STAGES.items() if stage.output.endswith((".png", ".html")))

# The stages that only methods of others need.
OF_OTHERS = ("tiles", "prompts", "method_metrics")

# The stages from a scene's recording to its scores.
PIPELINE = tuple(name for name in STAGES if name not in (*PAGES, *OF_OTHERS))


def path_help(stage: Stage) -> dict[str, str]:
    """Get a line of help for each path of a stage, by name: inputs, optional inputs, and ``output``."""
    inputs = {name: PATHS.get(name) or f"the scene's {STAGES[name].output}" for name in stage.inputs}
    optional = {name: f"the scene's {STAGES[name].output}, {when}" for name, when in stage.optional.items()}
    return inputs | optional | {"output": f"where to write {stage.output}"}


def run_stage(name: str, options: "Options | None", **given: Any) -> None:
    """Run a stage, if it has keys with options, on its paths and its values from the table of scenes, by name."""
    stage = STAGES[name]
    # ``run`` takes the path of an input as ``frames_path``; inside it, ``frames`` is the opened artifact.
    inputs = {*stage.inputs, *stage.optional}
    arguments = {f"{key}_path" if key in inputs else key: value for key, value in given.items()}
    import_module(stage.module).run(**arguments, **({} if options is None else {"options": options}))


def load_module(name: str, value: str) -> ModuleType:
    """Import the module that a stage chooses by a value (UserError: the value has no module)."""
    return import_module(STAGES[name].modules.find(value))


@functools.cache  # rules ask for every job
def code_of(name: str, value: str | None = None) -> str:
    """Hash the code that a stage executes with a value, without one what all values share, and its libraries' versions."""
    stage = STAGES[name]
    chosen = () if value is None else (stage.modules.find(value),)
    return code_hash(stage.module, *chosen, libraries=stage.libraries)
