"""What this machine and a configuration can do: ``egosplat doctor``."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from egosplat.config import Config
from egosplat.doctor.configured import chosen_point, read_configuration
from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.inputs import model_findings, recording_findings, suitability_findings
from egosplat.doctor.machine import machine_findings
from egosplat.doctor.times import MEASURED_ON, estimate, spoken
from egosplat.errors import UserError
from egosplat.scenes import Scene, read_scenes


def examine(files: Sequence[Path], options: Sequence[str]) -> list[Finding]:
    """All findings about this machine and the configuration.

    Args:
        files, options: see ``configured.read_configuration``.

    Raises:
        UserError: the configuration itself is wrong.
    """
    config, sources = read_configuration(files, options)
    origin = ", ".join(sources) or "defaults; there is no config/config.yaml here"
    findings = [Finding(Mark.OK, "configuration", f"preset {config['preset']} ({origin})")]
    findings += [*_budget(config), *machine_findings(config), *model_findings(config)]
    try:
        scenes = list(read_scenes(config).values())
    except UserError as error:
        return [*findings, Finding(Mark.MISSING, "scenes", str(error))]
    findings += [*recording_findings(config, scenes), *suitability_findings(scenes)]
    return [*findings, *_time(config, scenes)]


def _budget(config: Config) -> Iterator[Finding]:
    """The point that a budget chooses."""
    if point := chosen_point(config):
        measured = (
            f"{point['label']}, measured at {point['minutes']:g} minutes, accuracy {point['accuracy']:g}"
        )
        yield Finding(Mark.OK, "budget", measured)


def _time(config: Config, scenes: list[Scene]) -> Iterator[Finding]:
    """The expected time of the first scene whose recording is there or can be made."""
    scene = next((scene for scene in scenes if scene.synthetic or scene.recording.exists()), None)
    if scene is None:
        yield Finding(Mark.NOTE, "expected time", "no scene of the table has a recording")
        return
    expected = estimate(scene.config, scene.synthetic, _rasterizer(config))
    parts = {
        "filming": expected.synthetic,
        "reading": expected.reading,
        "segments": expected.segments,
        "what moves": expected.transient,
        "training": expected.splats,
        "asking": expected.asking,
    }
    known = {name: seconds for name, seconds in parts.items() if seconds}
    told = ", ".join(f"{name} {spoken(seconds)}" for name, seconds in known.items())
    unknown = [name for name, seconds in parts.items() if seconds is None]
    value = f"{scene.dataset}/{scene.scene}: about {spoken(sum(known.values()))} ({told})" if known else ""
    advice = f"Scaled from figures measured on {MEASURED_ON}"
    if unknown:
        advice += f"; none of this kind for {', '.join(unknown)}"
    yield Finding(Mark.NOTE, "expected time", value or f"{scene.dataset}/{scene.scene}: not known", advice)


def _rasterizer(config: Config) -> str:
    """The kernels' variant if they will render, else the kind of backend."""
    from egosplat.kernels import library
    from egosplat.splats.device import training_device

    backend = config["splats"]["backend"]
    try:
        device = training_device(backend).type
    except UserError:
        return backend
    return library.variant() if device == "cpu" and backend != "reference" and library.is_usable() else device
