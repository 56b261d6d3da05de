"""``egosplat doctor``: check whether this machine can run a configuration, and estimate how long it takes."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from egosplat.doctor import inputs
from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.machine import machine_findings
from egosplat.errors import UserError
from egosplat.pipeline.config import Config
from egosplat.pipeline.costs import UNREAD_FRAMES, Sizes, minutes
from egosplat.pipeline.dag import stages_behind
from egosplat.pipeline.scenes import Scene, read_scenes
from egosplat.pipeline.stages import PIPELINE

_RUN_MODELS = {"segments", "view_features"}
_RENDER = {"transient", "instances", "splats", "language", "metrics"}

# Least and largest factor of the table's times: other processors, kernels without AVX, more or fewer things in a scene.
_RANGE = (0.5, 3.0)


def examine(files: Sequence[Path], options: Sequence[str]) -> list[Finding]:
    """All findings about this machine and the configuration; arguments and errors as ``inputs.read_configuration``."""
    config, sources = inputs.read_configuration(files, options)
    # A wrong configuration ends here; every later problem is a finding, so that one call shows all of them.
    findings = [Finding(Mark.OK, "configuration", f"preset {config['preset']} ({', '.join(sources)})")]
    findings += [*machine_findings(config), *inputs.model_findings(config)]
    try:
        scenes = [scene for scene in read_scenes(config).values() if not scene.by_name]
    except UserError as error:
        return [*findings, Finding(Mark.MISSING, "scenes", str(error))]
    findings += [*inputs.scene_model_findings(config, scenes), *inputs.recording_findings(config, scenes)]
    findings += inputs.suitability_findings(scenes)
    return [*findings, *_times(scenes)]


def _times(scenes: list[Scene]) -> Iterator[Finding]:
    """The expected time of every scene whose recording exists or can be made; equal ones share a line."""
    groups: dict[tuple[float, tuple[str, ...]], list[Scene]] = {}
    for scene in scenes:
        if not scene.lacks_recording:
            config = scene.config
            found = estimate(config, scene.synthetic, _renders_on(config), _models_device(config))
            groups.setdefault(found, []).append(scene)
    if not groups:
        yield Finding(Mark.NOTE, "expected time", "no scene of the table has a recording")
    for (expected, unknown), group in groups.items():
        names = ", ".join(scene.name for scene in group)
        least, most = (duration(60 * expected * factor) for factor in _RANGE)
        advice = "Measured on two cores with AVX-512"
        if any(not scene.synthetic for scene in group):
            advice += "; a recording counts as two minutes long"
        if unknown:
            advice += f"; not known on this machine's device: {', '.join(unknown)}"
        each = " each" if len(group) > 1 else ""
        yield Finding(Mark.NOTE, "expected time", f"{names}: {least} to {most}{each}", advice)


def _models_device(config: Config) -> str:
    """The type of the device that runs SAM2 and OpenCLIP; ``cuda`` if the configuration requires a GPU that is missing."""
    from egosplat.compute import choose_compute

    try:
        return choose_compute(config["run"]["device"], config["run"]["precision"]).device.type
    except UserError:
        return config["run"]["device"]


def _renders_on(config: Config) -> str:
    """``cpu`` if the C++ kernels render, else another device, or the name of the backend."""
    from egosplat.gaussians.device import training_device
    from egosplat.rasterize.kernels import library

    backend = config["run"]["backend"]
    try:
        device = training_device(backend).type
    except UserError:
        return backend
    return "reference" if device == "cpu" and not library.is_usable() else device


def estimate(
    config: Config, synthetic: bool, renders_on: str = "cpu", models_on: str = "cpu"
) -> tuple[float, tuple[str, ...]]:
    """Expected time of a scene's scores on two cores [min], and the stages that it leaves out because they run elsewhere.

    Args:
        synthetic: whether its recording is synthetic. The length of a real one is unknown before it is read.
        renders_on, models_on: types of the devices; ``cpu`` of the renderer for the C++ kernels.
    """
    film = config["synthetic"]
    recorded = film["seconds"] * film["fps"] if synthetic else UNREAD_FRAMES
    needed = [stage for stage in stages_behind(["metrics"], config) if stage in PIPELINE]
    needed = ["synthetic", *needed] if synthetic else needed
    elsewhere = (_RUN_MODELS if models_on != "cpu" else set()) | (_RENDER if renders_on != "cpu" else set())
    known = (
        minutes(stage, config, Sizes(stage, config, frames=recorded / config["frames"]["stride"]))
        for stage in needed
        if stage not in elsewhere
    )
    return sum(known), tuple(stage for stage in needed if stage in elsewhere)


def duration(seconds: float) -> str:
    """``40 s``, ``12 min`` or ``3.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.3g} h"
