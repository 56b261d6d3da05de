"""Run a stage from Python."""

from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.pipeline import stages
from egosplat.pipeline.config import stage_options
from egosplat.pipeline.messages import make_options

# Values of the table of scenes that a stage may do without.
_SCENE = {"title": "scene", "method": None, "preset": None, "world_seed": None, "camera": None}


def run_stage(name: str, **values: Any) -> None:
    """Run a stage of the pipeline, as its command does: ``run_stage("splats", frames=..., poses=..., output=...)``.

    ``values`` are its inputs and ``output``, as paths, and the keys that differ from their defaults, such as ``iterations=7000``.
    UserError: there is no such stage, a path is missing, or a key is unknown or has a forbidden value; also as the stage."""
    if (stage := stages.STAGES.get(name)) is None:
        raise UserError(f"run_stage: there is no stage {name!r}; there are {', '.join(stages.STAGES)}")
    needed = {*stage.inputs, *stage.scene, "output"} - _SCENE.keys()
    if missing := sorted(needed - values.keys()):
        raise UserError(f"run_stage {name}: needs {', '.join(missing)}")
    given = {key: values.pop(key, _SCENE.get(key)) for key in stage.scene}
    paths = {key: values.pop(key) for key in {*stage.inputs, *stage.optional, "output"} & values.keys()}
    given |= {key: path and Path(path) for key, path in paths.items()}
    if options := stage_options(name):
        return stages.run_stage(name, make_options(options, values, f"run_stage {name}", name), **given)
    if values:
        raise UserError(f"run_stage {name}: {min(values)} is no input, and the stage has no keys")
    return stages.run_stage(name, None, **given)
