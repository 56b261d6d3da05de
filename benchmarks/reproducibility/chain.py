"""The stages of a small scene, each run with the reference's artifacts or with those of the stages before it."""

from pathlib import Path

from egosplat.pipeline import config as configuration
from egosplat.pipeline.running import run_stage
from egosplat.pipeline.stages import PIPELINE, STAGES
from egosplat.progress import log

PRESETS = Path(__file__).resolve().parents[2] / "config" / "presets"

# Keys of a scene of some ten pictures.
SMALL = {
    "synthetic": {"size": 256, "fps": 2.0, "seconds": 6.0, "objects": 16},
    "frames": {"resolution": 128, "evaluation_frames": 3},
    "segments": {"points_per_side": 10, "image_size": 256},
    "transient": {"iterations": 60, "resolution": 64, "input_size": 64},
    "splats": {
        "masking": "refined",
        "iterations": 200,
        "max_points": 4000,
        "max_gaussians": 8000,
        "evaluate_every": 100,
    },
    "survey": {"min_view_change_deg": 0},
}

_MASKED = ("splats", "language")
# What each stage takes of what the others make, where splats.masking is refined.
INPUTS = {name: STAGES[name].inputs + (("masks",) if name in _MASKED else ()) for name in PIPELINE}

# Arguments of stages other than keys and artifacts.
WORDS = {"frames": {"format": "adt"}, "metrics": {"title": "small"}}


def file_of(stage: str) -> str:
    """Name of what a stage makes."""
    return STAGES[stage].output


def run_chain(folder: Path, reference: Path | None) -> None:
    """Run all stages; write to ``folder``, read from ``reference`` or, without one, from ``folder``.

    Raises:
        UserError: a stage ends with it.
    """
    config = configuration.resolve(SMALL, PRESETS)
    folder.mkdir(parents=True, exist_ok=True)
    for stage, inputs in INPUTS.items():
        log(f"{folder.name}: {stage}")
        source = reference or folder
        paths = {name: source / (name if name == "recording" else file_of(name)) for name in inputs}
        paths |= {"output": folder / file_of(stage)}
        run_stage(stage, **paths, **configuration.stage_values(stage, config), **WORDS.get(stage, {}))
