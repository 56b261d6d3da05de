"""Check the models and recordings that the configuration names."""

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.notices import scene_notice
from egosplat.errors import UserError, user_message
from egosplat.models.checkpoints import CLIP, SAM2, ModelSpec, find_checkpoint, model_hash
from egosplat.pipeline.config import Config
from egosplat.pipeline.scenes import Scene, is_own

MIB = 1024**2

NAMED = 5
"""The number of missing recordings that are named."""


def model_findings(config: Config) -> Iterator[Finding]:
    """The architecture and checkpoint of each model, and the device that runs them. Checkpoints are read."""
    yield from (_model(model, config) for model in (SAM2, CLIP))
    if weights := config["transient"]["encoder_weights"]:
        yield _encoder(Path(weights).expanduser())
    yield _compute(config)


def recording_findings(config: Config, scenes: list[Scene]) -> Iterator[Finding]:
    """For each dataset in the table of scenes, which of its recordings exist."""
    for dataset, rows in groupby(
        sorted(scenes, key=lambda scene: scene.dataset), lambda scene: scene.dataset
    ):
        yield _recordings(dataset, config["data_root"].get(dataset), list(rows))


def suitability_findings(scenes: list[Scene]) -> Iterator[Finding]:
    """A warning for each real recording that the small checkpoints were not trained for."""
    for scene in scenes:
        if notice := scene_notice(scene):
            first, _, advice = notice.partition(". ")
            yield Finding(Mark.NOTE, f"{scene.dataset}/{scene.scene}", first, advice)


def _model(model: ModelSpec, config: Config) -> Finding:
    from egosplat.models.weights import read_tensors

    keys = config["models"]
    try:
        path = find_checkpoint(model, keys[model.checkpoint_key])
        content = model_hash(model, keys)
        read_tensors(path)
    except (UserError, OSError) as error:
        first, _, advice = (user_message(error) or str(error)).partition("\n")
        return Finding(Mark.MISSING, model.name, first, advice)
    size = f"{path.stat().st_size / MIB:.1f} MiB"
    checkpoint = f"checkpoint {keys[model.checkpoint_key]}, {size}, hash {content[:8]}"
    return Finding(Mark.OK, model.name, f"{keys[model.config_key]}, {checkpoint}")


def _encoder(path: Path) -> Finding:
    """The weights of the transient network's encoder."""
    from egosplat.models.weights import read_tensors

    try:
        read_tensors(path)
    except (UserError, OSError) as error:
        return Finding(Mark.MISSING, "encoder", f"transient.encoder_weights: {user_message(error) or error}")
    return Finding(Mark.OK, "encoder", f"{path}, {path.stat().st_size / MIB:.1f} MiB")


def _compute(config: Config) -> Finding:
    from egosplat.compute import choose_compute

    try:
        compute = choose_compute(config["models"]["device"], config["models"]["precision"])
    except UserError as error:
        return Finding(Mark.MISSING, "models run on", str(error))
    return Finding(Mark.OK, "models run on", f"{compute.device}, {str(compute.dtype).removeprefix('torch.')}")


def _recordings(dataset: str, root: str | None, scenes: list[Scene]) -> Finding:
    subject = f"{dataset} recordings"
    if all(scene.synthetic for scene in scenes):
        stand_in = f"data_root.{dataset} is not set: synthetic apartments replace its {len(scenes)} scenes"
        return Finding(Mark.OK, subject, stand_in)
    absent = [scene for scene in scenes if not scene.synthetic and not scene.recording.exists()]
    found = f"{len(scenes) - len(absent)} of {len(scenes)} below {root or Path.cwd()}"
    if not absent:
        return Finding(Mark.OK, subject, found)
    if not any(map(is_own, absent)):
        return Finding(Mark.NOTE, subject, f"none; data_root.{dataset} is not set")
    names = ", ".join(f"{scene.scene} ({scene.recording})" for scene in absent[:NAMED])
    more = f" and {len(absent) - NAMED} more" if len(absent) > NAMED else ""
    advice = f"Copy them there, set data_root.{dataset} to their folder, or remove their rows from the table of scenes"
    return Finding(Mark.MISSING, subject, f"{found}; missing: {names}{more}", advice)
