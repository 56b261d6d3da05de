"""``egosplat doctor``: check this machine, the configuration, and the models and recordings that it names."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from egosplat.doctor.findings import Finding, Mark, machine_findings, tried
from egosplat.errors import UserError, user_message, without_secrets
from egosplat.files import expand_home
from egosplat.models.checkpoints import CLIP, SAM2, ModelSpec, find_checkpoint, how_to_fetch, model_hash
from egosplat.models.suitability import configured_checkpoints, notice
from egosplat.pipeline.config import Config, LayeredConfig, merge, read_yaml, resolve, stage_values
from egosplat.pipeline.home import CONFIG, PRESETS, find_home
from egosplat.pipeline.model_sets import locate_checkpoints
from egosplat.pipeline.scenes import OTHER_PLACE, Scene, is_own, read_scenes, tables_of
from egosplat.pipeline.strict_yaml import load_yaml
from egosplat.transient.options import TransientOptions

MIB = 1024**2

# The number of missing recordings that are named.
NAMED = 5


def examine(files: Sequence[Path], options: Sequence[str]) -> list[Finding]:
    """All findings about this machine and the configuration; arguments and errors as ``read_configuration``."""
    config, sources = read_configuration(files, options)
    # A wrong configuration ends here; every later problem is a finding, so that one call shows all of them.
    findings = [Finding(Mark.OK, "configuration", f"preset {config['preset']} ({', '.join(sources)})")]
    findings += [*machine_findings(config), *_models(config)]
    try:
        scenes = [scene for scene in read_scenes(config).values() if not scene.by_name]
        _ = [scene.lacks_recording for scene in scenes]  # which the system may refuse to tell
    except (UserError, OSError) as error:
        return [*findings, Finding(Mark.MISSING, "scenes", user_message(error) or str(error))]
    # Another OpenCLIP than the configuration's, such as the words for photographs.
    known = {config["models"]["clip_checkpoint"]}
    for scene in scenes:
        checkpoint = scene.config["models"]["clip_checkpoint"]
        if checkpoint not in known and scene.recording.exists():
            known.add(checkpoint)
            findings.append(_model(CLIP, locate_checkpoints(scene.config), f"OpenCLIP, {scene.name}"))
    for dataset in sorted({scene.dataset for scene in scenes}):
        rows = [scene for scene in scenes if scene.dataset == dataset]
        findings.append(_recordings(dataset, config["data_root"].get(dataset), rows))
    for scene in scenes:
        if told := scene_notice(scene):
            first, _, advice = told.partition(". ")
            findings.append(Finding(Mark.NOTE, scene.name, first, advice))
    return findings


def scene_notice(scene: Scene) -> str | None:
    """The warning for a scene; None if the models suit its recording or it is absent."""
    suits = scene.rendered or not scene.recording.exists()
    return None if suits else notice("real", configured_checkpoints(scene.config))


def read_configuration(files: Sequence[Path], options: Sequence[str]) -> tuple[LayeredConfig, list[str]]:
    """The whole configuration that Snakemake makes of the same options, and its sources.

    Files of ``--configfile`` override earlier ones and config/config.yaml, options of ``--config``, as ``preset=draft``, ``run={device:
    cpu}`` or ``run.device=cpu``, override the files. UserError: one cannot be read, or a key or value is not allowed."""
    read = [find_home(CONFIG), *files]
    config: Config = {}
    for layer in [*map(read_yaml, read), *map(_parsed, options)]:
        config = merge(config, layer)
    return resolve(config, find_home(PRESETS)), [*map(str, read), *map(without_secrets, options)]


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
        told = "not of the form KEY=VALUE, as in preset=draft or splats.iterations=5"
        raise UserError(f"--config {option[:80]}: {told}")
    for name in reversed(names[1:]):
        content = {name: content}
    return {names[0]: content}


def _models(config: Config) -> Iterator[Finding]:
    """The architecture and checkpoint of each model, and the device that runs them. Checkpoints are read."""
    from egosplat.compute import choose_compute

    def compute() -> str:
        chosen = choose_compute(config["run"]["device"], config["run"]["precision"])
        return f"{chosen.device}, {str(chosen.dtype).removeprefix('torch.')}"

    try:
        located = locate_checkpoints(config)
    except UserError as error:
        yield Finding(Mark.MISSING, "models", str(error))
        return
    yield _model(SAM2, located, SAM2.name)
    yield _model(CLIP, located, CLIP.name)
    if weights := config["transient"]["encoder_weights"]:
        yield tried("encoder", lambda: _encoder(expand_home(weights)))
    yield tried("models run on", compute)
    unmoved = TransientOptions(**stage_values("transient", config)).stays_at_start()
    if config["splats"]["masking"] != "none" and unmoved:
        first, _, advice = unmoved.partition(". ")
        yield Finding(Mark.NOTE, "transient", first, advice)


def _model(model: ModelSpec, config: Config, what: str) -> Finding:
    keys = config["models"]

    def read() -> str:
        size = _size(find_checkpoint(model, keys[model.checkpoint_key]))
        checkpoint = f"checkpoint {keys[model.checkpoint_key]}, {size}"
        return f"{keys[model.config_key]}, {checkpoint}, hash {model_hash(model, keys)[:8]}"

    return tried(what, read)


def _encoder(path: Path) -> str:
    if not path.is_file():
        raise UserError(f"transient.encoder_weights: there is no file {path}\n{how_to_fetch(path)}")
    return f"{path}, {_size(path)}"


def _size(path: Path) -> str:
    """The size of a file of weights that can be read."""
    from egosplat.models.weights import read_tensors

    read_tensors(path)
    return f"{path.stat().st_size / MIB:.1f} MiB"


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
        return Finding(Mark.NOTE, subject, f"{found}; data_root.{dataset} is not set")
    names = ", ".join(f"{scene.scene} ({scene.recording})" for scene in absent[:NAMED])
    names += f" and {len(absent) - NAMED} more" if len(absent) > NAMED else ""
    return Finding(Mark.MISSING, subject, f"{found}; missing: {names}", f"Copy them there, or {OTHER_PLACE}")
