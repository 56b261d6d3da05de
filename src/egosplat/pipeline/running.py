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

    Args:
        name: name of the stage.
        values: its inputs by name and ``output``, as paths; and the keys that differ from their defaults, such as
            ``iterations=7000``.

    Raises:
        UserError: there is no such stage, a path is missing, or a key is unknown or has a forbidden value; also as the stage.
    """
    if (stage := stages.STAGES.get(name)) is None:
        raise UserError(f"run_stage: there is no stage {name!r}; there are {', '.join(stages.STAGES)}")
    needed = [*stage.inputs, *(key for key in stage.scene if key not in _SCENE), "output"]
    if missing := [key for key in needed if key not in values]:
        raise UserError(f"run_stage {name}: needs {', '.join(missing)}")
    paths = {*stage.inputs, *stage.optional, "output"}
    given = {key: _SCENE[key] for key in stage.scene if key in _SCENE}
    given |= {key: value for key, value in values.items() if key in stage.scene}
    given |= {key: Path(value) for key, value in values.items() if key in paths}
    keys = {key: value for key, value in values.items() if key not in given}
    if (options := stage_options(name)) is None:
        if keys:
            raise UserError(f"run_stage {name}: {min(keys)} is no input, and the stage has no keys")
        return stages.run_stage(name, None, **given)
    return stages.run_stage(name, make_options(options, keys, f"run_stage {name}", name), **given)
