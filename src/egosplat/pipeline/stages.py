"""The table of stages: code, inputs, outputs and dependencies of each stage.

The command line, the checks, the sharing between variants and the rules' paths use ``STAGES``. A stage's keys
are the fields of its class of options. The packages beside this one add stages, and modules that stages choose by a value: each
entry point of the group ``egosplat.plugins`` names a module with ``STAGES``, ``MODULES``, and options of other ``SECTIONS``.
"""

import functools
from importlib import import_module, metadata
from types import ModuleType
from typing import Any

from egosplat.errors import UserError
from egosplat.pipeline.code_hash import code_hash
from egosplat.pipeline.stage import Stage

# The input that no stage writes.
PATHS = {"recording": "the recording's folder or video file"}

# When a stage reads what is no input of it in all configurations.
_WHEN = {
    "survey": "to train only on frames that add views",
    "transient": "if splats.masking is initial, or segments tracks what moves",
    "masks": "if splats.masking is refined",
    "splats": "to merge masks on: if splats.source is given, or nothing is masked or tracked",
    **dict.fromkeys(("instances", "features"), "if codes are learnt from it"),
    "tiles": "if language.method is field or quantized",
    "histories": "if what moves is tracked and language.method is lifted",
}

_OPENCV = "opencv-contrib-python-headless"


def _modules(**modules: str) -> dict[str, str]:
    return {value: f"egosplat.{name}" for value, name in modules.items()}


def _artifact(
    name: str, module: str, about: str, inputs: tuple[str, ...], libraries: tuple[str, ...], **more: Any
) -> Stage:
    """A stage that writes an artifact of its name, with keys in ``options.py`` of its room."""
    options = f"egosplat.{module.partition('.')[0]}.options:{name.title().replace('_', '')}Options"
    given = {"options": options, "libraries": ("numpy", "zarr", *libraries), **more}
    return Stage(name, f"egosplat.{module}", about, f"{name}.zarr", inputs, **given)


def _sheet(
    name: str, about: str, output: str, inputs: tuple[str, ...], libraries: tuple[str, ...] = (), **more: Any
) -> Stage:
    """A stage that draws a sheet of a scene."""
    given = {"libraries": ("matplotlib", *libraries), "scene": ("title",), **more}
    return Stage(name, f"egosplat.report.sheets.{name}", about, output, inputs, **given)


_STAGES = (
    _artifact(
        *("frames", "frames.stage", "Read and rectify frames, and choose those to evaluate."),
        inputs=("recording",),
        libraries=(_OPENCV, "projectaria-tools", "pycolmap"),
        scene=("format",),
        by="format",
        modules=_modules(adt="frames.adt", hoi4d="frames.hoi4d", plain="frames.pictures"),
        request=(1500, 200, 20, 20),
    ),
    _artifact(
        *("annotations", "frames.annotations_stage", "Read the instance maps of the evaluation frames."),
        inputs=("recording", "frames"),
        libraries=(_OPENCV, "projectaria-tools"),
        by="format",
        modules=_modules(
            adt="frames.adt_annotations", hoi4d="frames.hoi4d", plain="frames.plain_annotations"
        ),
        request=(1500, 200, 30, 100),
    ),
    _artifact(
        *("poses", "poses.stage", "Get camera poses: from the device, a file, or COLMAP."),
        inputs=("recording", "frames"),
        libraries=("scipy", "pycolmap", "projectaria-tools"),
        by="poses.method",
        modules=_modules(device="poses.adt", known="poses.known", colmap="poses.colmap"),
        request=(5000, 3000, 60, 2000),
    ),
    Stage(
        *("survey", "egosplat.survey.stage", "Decide if a scene is static and which frames add views."),
        options="egosplat.survey.options:SurveyOptions",
        output="survey.json",
        inputs=("frames", "poses"),
        libraries=("jsonschema", "numpy", _OPENCV, "scipy", "zarr"),
    ),
    _artifact(
        *("transient", "transient.stage", "Train a network that predicts moving pixels."),
        inputs=("frames", "poses"),
        optional=("survey",),
        libraries=(_OPENCV, "scipy", "timm", "torch"),
        request=(6500, 1000, 120, 1000),
    ),
    _artifact(
        *("segments", "segments.stage", "Find instances at three levels in the frames."),
        inputs=("frames",),
        optional=("survey", "transient"),
        libraries=("scipy", _OPENCV, "torch", "torchvision", "sam2"),
        by_chunks=True,
        request=(9000, 500, 120, 4000),
    ),
    _artifact(
        *("instances", "instances.stage", "Merge masks into instances that hold in 3D."),
        inputs=("frames", "poses", "segments"),
        optional=("survey", "splats"),
        libraries=(_OPENCV, "scipy", "torch"),
        request=(6500, 2500, 60, 2000),
    ),
    _artifact(
        *("view_features", "features.view_features_stage", "Encode each instance's crops with OpenCLIP."),
        inputs=("frames", "instances"),
        libraries=("open_clip_torch", "pillow", "scipy", "torch"),
        by_chunks=True,
        request=(6000, 2000, 60, 1000),
    ),
    _artifact(
        *("features", "features.stage", "Aggregate the features of each instance over its views."),
        inputs=("view_features",),
        libraries=("torch",),
        request=(3000, 600, 30, 100),
    ),
    _artifact(
        *("masks", "transient.masks_stage", "Mask what moves in every frame."),
        inputs=("frames", "transient", "instances"),
        libraries=(),
    ),
    _artifact(
        *("splats", "splats.stage", "Train 3D Gaussians on the frames, or read them."),
        inputs=("frames", "poses"),
        optional=("survey", "transient", "masks", "instances", "features"),
        libraries=("scipy", "torch"),
        request=(6500, 1500, 120, 1500),
    ),
    _artifact(
        *("language", "language.stage", "Assign each Gaussian the code of its instance."),
        inputs=("frames", "poses", "splats"),
        optional=("survey", "transient", "masks", "instances", "features", "tiles"),
        libraries=("scipy", "torch"),
        by="language.method",
        modules=_modules(joint="language.joint", lifted="language.dominant"),
        request=(6500, 1500, 60, 1000),
    ),
    _artifact(
        *("histories", "histories.stage", "Find what is carried, and what lies somewhere for a while."),
        inputs=("frames", "poses", "instances", "view_features", "splats"),
        optional=("masks",),
        libraries=("open_clip_torch", _OPENCV, "scipy", "torch"),
        request=(6000, 500, 60, 1800),
    ),
    Stage(
        *("metrics", "egosplat.evaluation.stage", "Query every annotated category, and score the answers."),
        options="egosplat.evaluation.options:MetricsOptions",
        output="metrics.json",
        inputs=("frames", "poses", "annotations", "splats", "language"),
        optional=("features", "tiles", "histories"),
        libraries=("jsonschema", "numpy", "open_clip_torch", _OPENCV, "scipy", "torch", "zarr"),
        scene=("title", "method", "preset", "world_seed", "camera"),
        request=(7000, 1000, 60, 600),
    ),
    _sheet(
        *("contact_sheet", "Draw a scene's frames, annotations and trajectory.", "contact_sheet.png"),
        inputs=("frames", "annotations", "poses"),
        libraries=("adjustText",),
    ),
    _sheet(
        *("language_sheet", "Draw the Gaussians' codes from several directions.", "language.png"),
        inputs=("poses", "splats", "language"),
        libraries=("scipy", "torch"),
        request=(6500, 600, 30, 100),
    ),
    _sheet(
        *("transient_sheet", "Draw what moves, its masks, and renders without it.", "transient.png"),
        inputs=("frames", "poses", "transient", "instances", "masks", "splats"),
        libraries=("adjustText", "torch"),
        request=(6500, 600, 30, 100),
    ),
    _sheet(
        *("carries_sheet", "Draw what is carried from where to where, and when.", "carries.png"),
        inputs=("frames", "poses", "splats", "histories"),
        libraries=("adjustText",),
    ),
    _sheet(
        *("crops_sheet", "Draw the crops of instances, with outliers crossed out.", "crops.png"),
        inputs=("frames", "instances", "view_features", "features"),
    ),
    _sheet(
        *("instances_sheet", "Draw the instances of each level in frames and from above.", "instances.png"),
        inputs=("frames", "poses", "instances"),
    ),
    _sheet("splats_sheet", "Draw held-out frames next to their renders.", "splats.png", ("frames", "splats")),
    _sheet(
        *("queries_sheet", "Draw the queries with the best and the worst answers.", "queries.png"),
        inputs=("frames", "poses", "annotations", "splats", "language", "metrics"),
        optional=("features", "tiles", "histories"),
        libraries=("open_clip_torch", _OPENCV, "torch"),
        request=(6500, 600, 30, 100),
    ),
    Stage(
        *("scene_page", "egosplat.viewing.stage", "Write the scene as one HTML file that can be asked."),
        options="egosplat.viewing.options:ScenePageOptions",
        output="scene.html",
        inputs=("frames", "poses", "instances", "features", "splats", "language"),
        optional=("histories",),
        libraries=("open_clip_torch", _OPENCV, "torch"),
        scene=("title",),
    ),
)


# Of this distribution alone: entry points of all installed ones take as long as the rest of the start.
_POINTS = metadata.distribution("egosplat").entry_points.select(group="egosplat.plugins")
PLUGINS = [point.load() for point in _POINTS]


def _with_plugins(own: tuple[Stage, ...]) -> dict[str, Stage]:
    """Get the stages by name in the order of the pipeline, with those of the packages beside this one."""
    stages = [*own]
    for stage in (stage for plugin in PLUGINS for stage in plugin.STAGES):
        stages.insert([other.name for other in stages].index(stage.before), stage)
    found = {stage.name: stage for stage in stages}
    for name, modules in (item for plugin in PLUGINS for item in plugin.MODULES.items()):
        found[name].modules.update(modules)
    return found


# Stages by name, in the order of the pipeline.
STAGES = _with_plugins(_STAGES)

# The stages that write one file, by default under the name ``output``; those of them that draw a page; and those from a scene's
# recording to its scores.
FILES = tuple(name for name, stage in STAGES.items() if stage.output.endswith((".json", ".png", ".html")))
PAGES = tuple(name for name, stage in STAGES.items() if stage.output.endswith((".png", ".html")))
PIPELINE = tuple(name for name, stage in STAGES.items() if name not in PAGES and not stage.aside)


def path_help(stage: Stage) -> dict[str, str]:
    """Get a line of help for each path of a stage, by name: inputs, optional inputs, and ``output``."""
    inputs = {name: PATHS.get(name) or f"the scene's {STAGES[name].output}" for name in stage.inputs}
    optional = {name: f"the scene's {STAGES[name].output}, {_WHEN[name]}" for name in stage.optional}
    return inputs | optional | {"output": f"where to write {stage.output}"}


def run_stage(name: str, options: Any, **given: Any) -> None:
    """Run a stage, with options if it has keys, on its paths and its values from the table of scenes, by name."""
    stage = STAGES[name]
    # ``run`` takes the path of an input as ``frames_path``; ``frames`` is the opened artifact.
    inputs = {*stage.inputs, *stage.optional}
    arguments = {f"{key}_path" if key in inputs else key: value for key, value in given.items()}
    import_module(stage.module).run(**arguments, **({"options": options} if options else {}))


def load_module(name: str, value: str) -> ModuleType:
    """Import the module that a stage chooses by a value (UserError: the value has no module)."""
    return import_module(_chosen(name, value))


def _chosen(name: str, value: str) -> str:
    stage = STAGES[name]
    if value not in stage.modules:
        raise UserError(f"{stage.by}: {value!r} is unknown; choose from {', '.join(stage.modules)}.")
    return stage.modules[value]


@functools.cache  # rules ask for every job
def code_of(name: str, value: str | None = None) -> str:
    """Hash the code that a stage executes with a value, without one what all values share, and its libraries' versions."""
    stage = STAGES[name]
    chosen = () if value is None else (_chosen(name, value),)
    return code_hash(stage.module, *chosen, libraries=stage.libraries)
