"""``egosplat doctor``: check whether this machine can run a configuration, and estimate how long it takes."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from egosplat.cost_model.expected import expected_seconds
from egosplat.cost_model.laws import MEASURED_ON
from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.inputs import (
    model_findings,
    read_configuration,
    recording_findings,
    suitability_findings,
)
from egosplat.doctor.machine import machine_findings
from egosplat.errors import UserError
from egosplat.pipeline.config import Config
from egosplat.pipeline.dag import leaves_frames_out, survey_decides, tracks_what_moves
from egosplat.pipeline.scenes import Scene, read_scenes


def examine(files: Sequence[Path], options: Sequence[str]) -> list[Finding]:
    """All findings about this machine and the configuration.

    Args:
        files, options: see ``configuration.read_configuration``.

    Raises:
        UserError: the configuration itself is wrong.
    """
    config, sources = read_configuration(files, options)
    # A wrong configuration ends here; every later problem is a finding, so that one call shows all of them.
    origin = ", ".join(sources) or "defaults; there is no config/config.yaml here"
    findings = [Finding(Mark.OK, "configuration", f"preset {config['preset']} ({origin})")]
    findings += [*machine_findings(config), *model_findings(config)]
    try:
        scenes = [scene for scene in read_scenes(config).values() if not scene.by_name]
    except UserError as error:
        return [*findings, Finding(Mark.MISSING, "scenes", str(error))]
    findings += [*recording_findings(config, scenes), *suitability_findings(scenes)]
    return [*findings, *_times(scenes)]


def _times(scenes: list[Scene]) -> Iterator[Finding]:
    """The expected time of every scene whose recording exists or can be made; equal ones share a line."""
    groups: dict[tuple[tuple[str, float | None], ...], list[str]] = {}
    for scene in scenes:
        if scene.synthetic or scene.recording.exists():
            expected = estimate(
                scene.config, scene.synthetic, _rasterizer(scene.config), _models_device(scene.config)
            )
            groups.setdefault(tuple(expected.items()), []).append(f"{scene.dataset}/{scene.scene}")
    if not groups:
        yield Finding(Mark.NOTE, "expected time", "no scene of the table has a recording")
    for expected, names in groups.items():
        yield _time(dict(expected), names)


def _time(expected: Mapping[str, float | None], names: list[str]) -> Finding:
    known = {part: seconds for part, seconds in expected.items() if seconds}
    parts = ", ".join(f"{part} {duration(seconds)}" for part, seconds in known.items())
    unknown = [part for part, seconds in expected.items() if seconds is None]
    each = " each" if len(names) > 1 else ""
    value = f"about {duration(sum(known.values()))}{each} ({parts})" if known else "not known"
    advice = f"Extrapolated from measurements on {MEASURED_ON}"
    if unknown:
        advice += f"; not known: {', '.join(unknown)}"
    return Finding(Mark.NOTE, "expected time", f"{', '.join(names)}: {value}", advice)


def _models_device(config: Config) -> str:
    """The type of the device that runs SAM2 and OpenCLIP; ``cuda`` if the configuration requires a GPU that is missing."""
    from egosplat.compute import choose_compute

    try:
        return choose_compute(config["run"]["device"], config["run"]["precision"]).device.type
    except UserError:
        return config["run"]["device"]


def _rasterizer(config: Config) -> str:
    """The variant of the C++ kernels if they render, else the name of the backend."""
    from egosplat.gaussians.device import training_device
    from egosplat.rasterize.kernels import library

    backend = config["run"]["backend"]
    try:
        device = training_device(backend).type
    except UserError:
        return backend
    return library.variant() if device == "cpu" and backend != "reference" and library.is_usable() else device


# The parts of the main job, and the stages of each. Report pages and tables are not included.
PARTS = {
    "filming": ("synthetic",),
    "reading": ("frames", "annotations", "poses", "survey"),
    "segments": ("segments", "instances"),
    "features": ("view_features", "features"),
    "transient": ("transient", "masks"),
    "training": ("splats",),
    "queries": ("language", "metrics"),
}


def estimate(
    config: Config, synthetic: bool, rasterizer: str, models_on: str = "cpu"
) -> dict[str, float | None]:
    """Expected seconds of each part of a scene's main job, on two cores.

    Args:
        synthetic: whether its recording is synthetic. The length of a real one is unknown before it is read.
        rasterizer: the variant of the C++ kernels that renders; for other backends no times were measured.
        models_on: the type of the device that runs SAM2 and OpenCLIP.

    Returns:
        Seconds by part; 0 where the part is not needed, None where nothing was measured.
    """
    skipped = _skipped(config, synthetic)

    def of_part(stages: tuple[str, ...]) -> float | None:
        found = [
            expected_seconds(stage, config, synthetic, rasterizer, models_on)
            for stage in stages
            if stage not in skipped
        ]
        return None if None in found else sum(found)

    return {part: of_part(stages) for part, stages in PARTS.items()}


def _skipped(config: Config, synthetic: bool) -> set[str]:
    """Stages that the scene does not need."""
    skipped = set() if synthetic else {"synthetic"}
    if config["splats"]["masking"] == "none":
        skipped |= {"masks"} if tracks_what_moves(config) else {"transient", "masks"}
    if not (survey_decides(config) or leaves_frames_out(config)):
        skipped.add("survey")
    return skipped


def duration(seconds: float) -> str:
    """``40 s``, ``12 min`` or ``3.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.3g} h"
