"""Notices about results that a run replaces because its settings differ.

Only the options recorded in an artifact's JSON are compared: neither Zarr nor PyTorch is imported. A change of code or of a
recording gives no notice; Snakemake's plan names its reason.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.files import read_json
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config
from egosplat.pipeline.dag import AUTO, BY_SURVEY, default_pages, stages_behind
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.home import snakemake_in
from egosplat.pipeline.messages import shown
from egosplat.pipeline.options import keys_of
from egosplat.pipeline.results import default_scenes
from egosplat.pipeline.scenes import Scene, Target, find_scene
from egosplat.pipeline.stages import PAGES, STAGES
from egosplat.pipeline.variants import PRESET_FILES, artifact_path, scene_config

# Largest number of keys, and of scenes, in a message.
NAMED = 4

# Recorded and current value by key, such as ``splats.iterations``.
Changes = dict[str, tuple[Any, Any]]


@dataclass(frozen=True)
class Asked:
    """A scene, or its variant, with its folder, the names of the requested files below it, and its configuration.

    ``path_of`` gets the path of a stage's artifact, and ``with_preset`` the same configuration with another preset.
    """

    folder: Path
    variant: str | None
    goals: tuple[str, ...]
    config: Config
    path_of: Callable[[str], Path]
    with_preset: Callable[[str], Config]


@dataclass(frozen=True)
class Replaced:
    """Artifacts, in the order of the stages, that were made with other settings, which one preset may explain."""

    asked: Asked
    artifacts: tuple[Path, ...]
    changes: Changes
    preset: str | None


Scenes = Mapping[tuple[str, str], Scene]


def asked_results(
    scenes: Scenes, targets: Iterable[Target], with_preset: Callable[[str], Scenes]
) -> list[Asked]:
    """List the requested scenes and variants; without targets, all scenes of the default run.

    Args:
        with_preset: reads the same table with another preset.
    """
    names: dict[tuple[str, str, str | None], list[str]] = {}
    for target in targets:
        names.setdefault((target.dataset, target.scene, target.variant), []).append(target.name)
    if not names:
        for scene in default_scenes(scenes.values()):
            names[scene.dataset, scene.scene, None] = default_pages(scene.config)
    return [
        _asked(find_scene(scenes, dataset, scene), variant, tuple(goals), with_preset)
        for (dataset, scene, variant), goals in names.items()
    ]


def _asked(
    scene: Scene, variant: str | None, goals: tuple[str, ...], with_preset: Callable[[str], Scenes]
) -> Asked:
    return Asked(
        scene.results,
        variant,
        goals,
        scene_config(scene, variant),
        lambda stage: Path(artifact_path(stage, scene, variant)),
        lambda preset: scene_config(with_preset(preset)[scene.dataset, scene.scene], variant),
    )


def replacement_notices(asked: Iterable[Asked]) -> list[str]:
    """Format a line for each scene with replaced results, and one that says how to keep both."""
    found = [replaced for one in asked if (replaced := find_replaced(one)) is not None]
    if not found:
        return []
    more = [f"and results of {len(found) - NAMED} more scenes"] if len(found) > NAMED else []
    return [*map(_notice, found[:NAMED]), *more, _way_to_keep_both(found[0])]


def find_replaced(asked: Asked) -> Replaced | None:
    """Find existing inputs of the requested files that were made with other settings, or None."""
    # A figure has no keys of its own.
    stages = [stage for stage in stages_of(asked.goals, asked.config) if stage not in PAGES]
    found = {stage: _recorded_options(asked.path_of(stage)) for stage in stages}
    records = {stage: options for stage, options in found.items() if options is not None}
    changes = {stage: _changes(stage, options, asked.config) for stage, options in records.items()}
    artifacts = tuple(asked.path_of(stage) for stage in records if changes[stage])
    if not artifacts:
        return None
    every = {key: values for stage in records for key, values in changes[stage].items()}
    preset = _preset_of(records, asked)
    recording, filmed = asked.folder / "recording", {}
    if preset is not None and recording.is_dir():
        # A synthetic recording stores no options; its preset tells them.
        before, now = asked.with_preset(preset)["synthetic"], asked.config["synthetic"]
        filmed = {f"synthetic.{key}": (before[key], now[key]) for key in now if before[key] != now[key]}
    return Replaced(asked, ((recording,) if filmed else ()) + artifacts, filmed | every, preset)


def stages_of(goals: Iterable[str], config: Config) -> list[str]:
    """List the stages needed for files such as ``metrics.json``, including their own, in the order of the pipeline."""
    makers = {about.output: stage for stage, about in STAGES.items() if stage != "synthetic"}
    named = ("metrics" if name.startswith("tradeoff/") else makers.get(name) for name in goals)
    return stages_behind(filter(None, named), config)


def _recorded_options(path: Path) -> Mapping[str, Any] | None:
    """Read an artifact's recorded options; None if it is missing or damaged, which its reader reports."""
    try:
        is_artifact = path.suffix == ".zarr"
        document = read_json(path / "zarr.json")["attributes"]["egosplat"] if is_artifact else read_json(path)
        return dict(document["provenance"]["options"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _changes(stage: str, options: Mapping[str, Any], config: Config) -> Changes:
    values = configuration.stage_values(stage, config)
    names = {
        key: f"{part}.{key}" for part, keys in configuration.stage_sections(stage).items() for key in keys
    }
    return {
        names[key]: (options[key], value)
        for key, value in values.items()
        if options.get(key, value) != value and not (key in BY_SURVEY and value == AUTO)
    }


def _preset_of(records: Mapping[str, Mapping[str, Any]], asked: Asked) -> str | None:
    """Find the preset that explains all recorded options, the default before the others, or None."""
    about = keys_of(GeneralOptions)["preset"]
    for preset in sorted(about["enum"], key=lambda name: name != about["default"]):
        config = asked.with_preset(preset)
        if not any(_changes(stage, options, config) for stage, options in records.items()):
            return preset
    return None


def _notice(found: Replaced) -> str:
    names = ", ".join(str(path.relative_to(found.asked.folder)) for path in found.artifacts)
    now = found.asked.config["preset"]
    presets = f" (preset {found.preset} -> {now})" if found.preset not in (None, now) else ""
    values = [f"{key} {old} -> {new}" for key, (old, new) in list(found.changes.items())[:NAMED]]
    more = [f"{len(found.changes) - NAMED} more keys"] if len(found.changes) > NAMED else []
    return (
        f"{found.asked.folder}: this run replaces {names}, and everything made from them, because they were made with other "
        f"settings{presets}: {', '.join([*values, *more])}"
    )


def _way_to_keep_both(found: Replaced) -> str:
    asked, now = found.asked, found.asked.config["preset"]
    variant = next(name for name, file in PRESET_FILES.items() if file == now)
    if asked.variant is None and found.preset not in (None, now) and variant in asked.config["variants"]:
        target = f"{asked.folder}/variants/{variant}/metrics.json"
        return f"To keep both, stop this run and request a variant, with preset {found.preset}: {snakemake_in(Path())} --cores 2 {target}"
    return (
        f"To keep both, stop this run, leave the scene's settings, add to config/config.yaml  {_variant(found.changes)}  "
        f"and request {asked.folder}/variants/NAME/metrics.json"
    )


def _variant(changes: Changes) -> str:
    """Format the keys of a variant as YAML."""
    keys: Config = {}
    for key, (_, new) in changes.items():
        section, _, name = key.partition(".")
        keys.setdefault(section, {})[name] = new
    few = keys if len(changes) <= NAMED else {next(iter(keys)): keys[next(iter(keys))]}
    text = shown({"variants": {"NAME": few}})
    return text[1:-1] if len(changes) <= NAMED else f"{text[1:-3]}, ...}}}}"
