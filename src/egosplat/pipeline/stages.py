"""The stages of ``stages.toml``: code, inputs, outputs and dependencies of each.

The command line, the checks, the sharing between variants and the rules' paths use ``STAGES``. A stage's keys
are the fields of its class of options. The packages beside this one add stages, and modules that stages choose by a value: each
entry point of the group ``egosplat.plugins`` names a module with ``STAGES``, ``MODULES``, and options of other ``SECTIONS``.
"""

import functools
import tomllib
from importlib import import_module, metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from egosplat.errors import UserError
from egosplat.pipeline.code_hash import code_hash
from egosplat.pipeline.stage import Stage

# The input that no stage writes.
PATHS = {"recording": "the recording's folder or video file"}

# When a stage reads what is no input of it in all configurations.
_WHEN = {
    "poses": "to prompt only frames with a pose, if segments.prompting is each_frame",
    "survey": "to train only on frames that add views",
    "transient": "if splats.masking is initial, or segments tracks what moves",
    "masks": "if splats.masking is refined",
    "splats": "to merge masks on: if splats.source is given, or nothing is masked or tracked",
    **dict.fromkeys(("instances", "features"), "if codes are learnt from it"),
    "tiles": "if language.method is field or quantized",
    "histories": "if what moves is tracked and language.method is lifted",
}


# Of this distribution alone: entry points of all installed ones take as long as the rest of the start.
_POINTS = metadata.distribution("egosplat").entry_points.select(group="egosplat.plugins")
PLUGINS = [point.load() for point in _POINTS]


def _with_plugins() -> dict[str, Stage]:
    """Get the stages by name in the order of the pipeline: those of ``stages.toml``, and of the packages beside this one."""
    stages = []
    for name, row in tomllib.loads(Path(__file__).with_name("stages.toml").read_text()).items():
        given = {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
        stages.append(Stage(**{"name": name, "output": f"{name}.zarr", **given}))
    for stage in (stage for plugin in PLUGINS for stage in plugin.STAGES):
        stages.insert([other.name for other in stages].index(stage.before), stage)
    found = {stage.name: stage for stage in stages}
    for name, modules in (item for plugin in PLUGINS for item in plugin.MODULES.items()):
        found[name].modules.update(modules)
    return found


# Stages by name, in the order of the pipeline.
STAGES = _with_plugins()

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
