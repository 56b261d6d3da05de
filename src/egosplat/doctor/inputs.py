"""``egosplat doctor``: check this machine, the configuration, and the models and recordings that it names."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.machine import machine_findings
from egosplat.errors import UserError, user_message
from egosplat.files import expand_home
from egosplat.models.checkpoints import CLIP, FETCH, SAM2, ModelSpec, find_checkpoint, model_hash
from egosplat.models.suitability import configured_checkpoints, notice
from egosplat.pipeline.config import Config, LayeredConfig, merge, read_yaml, resolve
from egosplat.pipeline.home import config_file, presets_folder
from egosplat.pipeline.model_sets import locate_checkpoints
from egosplat.pipeline.recording_origin import recording_origin
from egosplat.pipeline.scenes import Scene, is_own, read_scenes, tables_of
from egosplat.pipeline.strict_yaml import load_yaml

MIB = 1024**2

# The number of missing recordings that are named.
NAMED = 5


def scene_notice(scene: Scene) -> str | None:
    """The warning for a scene; None if the models suit its recording or it is absent."""
    if scene.synthetic or not scene.recording.exists():
        return None
    try:
        origin = recording_origin(scene.format, scene.recording)
    except UserError:
        return None  # the stage frames reports what is wrong with the recording
    return notice(origin, configured_checkpoints(scene.config), aria=scene.format == "adt")


def examine(files: Sequence[Path], options: Sequence[str]) -> list[Finding]:
    """All findings about this machine and the configuration; arguments and errors as ``read_configuration``."""
    config, sources = read_configuration(files, options)
    # A wrong configuration ends here; every later problem is a finding, so that one call shows all of them.
    findings = [Finding(Mark.OK, "configuration", f"preset {config['preset']} ({', '.join(sources)})")]
    findings += [*machine_findings(config), *model_findings(config)]
    try:
        scenes = [scene for scene in read_scenes(config).values() if not scene.by_name]
    except UserError as error:
        return [*findings, Finding(Mark.MISSING, "scenes", str(error))]
    findings += scene_model_findings(config, scenes)
    for dataset in sorted({scene.dataset for scene in scenes}):
        rows = [scene for scene in scenes if scene.dataset == dataset]
        findings.append(_recordings(dataset, config["data_root"].get(dataset), rows))
    for scene in scenes:
        if told := scene_notice(scene):
            first, _, advice = told.partition(". ")
            findings.append(Finding(Mark.NOTE, scene.name, first, advice))
    return findings


def read_configuration(files: Sequence[Path], options: Sequence[str]) -> tuple[LayeredConfig, list[str]]:
    """The whole configuration that Snakemake makes of the same options, and its sources.

    Args:
        files: of ``--configfile``; later ones override earlier ones, all override config/config.yaml.
        options: of ``--config``, as ``preset=draft``, ``run={device: cpu}`` or ``run.device=cpu``; they
            override the files.

    Raises:
        UserError: a file or an option cannot be read, or a key or value is not allowed.
    """
    read = [config_file(), *files]
    config: Config = {}
    for path in read:
        config = merge(config, read_yaml(path))
    for option in options:
        config = merge(config, _parsed(option))
    return resolve(config, presets_folder()), [*map(str, read), *options]


def read_configurations(files: Sequence[Path], options: Sequence[str]) -> list[LayeredConfig]:
    """The configuration, and those of the scenes in its table, if the table exists; see ``read_configuration``."""
    config, _ = read_configuration(files, options)
    scenes = read_scenes(config).values() if tables_of(config)[0].is_file() else ()
    return [config, *(scene.config for scene in scenes)]


def _parsed(option: str) -> Config:
    key, equals, value = option.partition("=")
    try:
        content = load_yaml(value)
    except ValueError:
        content = None
    names = key.split(".")  # run.device=cpu is short for run={device: cpu}
    if not (equals and all(names)) or (content is None and value != "null"):
        raise UserError(
            f"--config {option[:80]}: not of the form KEY=VALUE, as in preset=draft or splats.iterations=5"
        )
    for name in reversed(names[1:]):
        content = {name: content}
    return {names[0]: content}


def model_findings(config: Config) -> Iterator[Finding]:
    """The architecture and checkpoint of each model, and the device that runs them. Checkpoints are read."""
    config = locate_checkpoints(config)
    yield from (_model(model, config) for model in (SAM2, CLIP))
    if weights := config["transient"]["encoder_weights"]:
        yield _encoder(expand_home(weights))
    yield _compute(config)


def scene_model_findings(config: Config, scenes: list[Scene]) -> Iterator[Finding]:
    """OpenCLIP where scenes with a recording have another one than the configuration, such as the words for photographs."""
    known = {config["models"]["clip_checkpoint"]}
    for scene in scenes:
        checkpoint = scene.config["models"]["clip_checkpoint"]
        if checkpoint not in known and scene.recording.exists():
            known.add(checkpoint)
            yield replace(_model(CLIP, locate_checkpoints(scene.config)), what=f"OpenCLIP, {scene.name}")


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
        advice = FETCH if not path.is_file() else ""
        return Finding(
            Mark.MISSING, "encoder", f"transient.encoder_weights: {user_message(error) or error}", advice
        )
    return Finding(Mark.OK, "encoder", f"{path}, {path.stat().st_size / MIB:.1f} MiB")


def _compute(config: Config) -> Finding:
    from egosplat.compute import choose_compute

    try:
        compute = choose_compute(config["run"]["device"], config["run"]["precision"])
    except UserError as error:
        return Finding(Mark.MISSING, "models run on", str(error))
    return Finding(Mark.OK, "models run on", f"{compute.device}, {str(compute.dtype).removeprefix('torch.')}")


def _recordings(dataset: str, root: str | None, scenes: list[Scene]) -> Finding:
    """Which recordings of a dataset exist."""
    subject = f"{dataset} recordings"
    if all(scene.synthetic for scene in scenes):
        stand_in = f"data_root.{dataset} is not set: synthetic apartments replace its {len(scenes)} scenes"
        return Finding(Mark.OK, subject, stand_in)
    absent = [scene for scene in scenes if scene.lacks_recording]
    found = f"{len(scenes) - len(absent)} of {len(scenes)} below {root or Path.cwd()}"
    if not absent:
        return Finding(Mark.OK, subject, found)
    if not any(map(is_own, absent)):
        return Finding(Mark.NOTE, subject, f"none; data_root.{dataset} is not set")
    names = ", ".join(f"{scene.scene} ({scene.recording})" for scene in absent[:NAMED])
    names += f" and {len(absent) - NAMED} more" if len(absent) > NAMED else ""
    advice = f"Copy them there, set data_root.{dataset} to their folder, or remove their rows from the table of scenes"
    return Finding(Mark.MISSING, subject, f"{found}; missing: {names}", advice)
