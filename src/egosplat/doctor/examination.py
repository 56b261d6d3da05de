"""``egosplat doctor``: check whether this machine can run a configuration."""

from collections.abc import Sequence
from pathlib import Path

from egosplat.doctor import inputs
from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.machine import machine_findings
from egosplat.errors import UserError
from egosplat.pipeline.scenes import read_scenes


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
    return [*findings, *inputs.suitability_findings(scenes)]
