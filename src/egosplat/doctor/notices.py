"""Warnings about scenes before a run starts: small checkpoints on a real recording, missing recordings."""

from collections.abc import Iterable, Mapping, Sequence

from egosplat.errors import UserError
from egosplat.frames.recording_files import recording_origin
from egosplat.models.suitability import configured_checkpoints, notice
from egosplat.pipeline.config import Config
from egosplat.pipeline.scenes import Scene, Target, is_own
from egosplat.pipeline.variants import variant_config

NAMED = 5
"""The number of skipped scenes that are named."""


def scene_notice(scene: Scene, config: Config | None = None) -> str | None:
    """The warning for a scene; None if the models suit its recording, or the recording does not exist.

    Args:
        scene: of the table of scenes.
        config: a variant's; None for the scene's own.
    """
    if scene.synthetic or not scene.recording.exists():
        return None
    try:
        origin = recording_origin(scene.format, scene.recording)
    except UserError:
        return None  # the stage frames reports what is wrong with the recording
    return notice(origin, configured_checkpoints(config or scene.config))


def plan_notices(scenes: Mapping[tuple[str, str], Scene], targets: Sequence[Target]) -> list[str]:
    """One line for each distinct warning about the targets, with the names of its scenes.

    Args:
        scenes: all of the table, by dataset and name.
        targets: below ``results``; empty for every scene.
    """
    found: dict[str, list[str]] = {}
    for name, warning in _scene_warnings(scenes, targets):
        if warning is not None and name not in found.setdefault(warning, []):
            found[warning].append(name)
    return [f"{', '.join(names)}: {warning}" for warning, names in found.items()]


def left_out_notices(scenes: Mapping[tuple[str, str], Scene], targets: Sequence[Target]) -> list[str]:
    """A line that names the user's own rows without recording, if all scenes are targets.

    Args:
        scenes, targets: as ``plan_notices``; a target of a scene without its recording is an error of its own.
    """
    absent = [
        scene
        for scene in scenes.values()
        if is_own(scene) and not scene.synthetic and not scene.recording.exists()
    ]
    if targets or not absent:
        return []
    names = ", ".join(f"{one.dataset}/{one.scene} ({one.recording})" for one in absent[:NAMED])
    more = f" and {len(absent) - NAMED} more" if len(absent) > NAMED else ""
    return [f"skipped, their recordings are missing: {names}{more}"]


def _scene_warnings(
    scenes: Mapping[tuple[str, str], Scene], targets: Sequence[Target]
) -> Iterable[tuple[str, str | None]]:
    if not targets:
        return [(f"{scene.dataset}/{scene.scene}", scene_notice(scene)) for scene in scenes.values()]
    return [_target_warning(scenes[target.dataset, target.scene], target) for target in targets]


def _target_warning(scene: Scene, target: Target) -> tuple[str, str | None]:
    where = f"{scene.dataset}/{scene.scene}"
    if target.variant is None:
        return where, scene_notice(scene)
    config = variant_config(scene.config, target.variant, where)
    return f"{where}, {target.variant}", scene_notice(scene, config)
