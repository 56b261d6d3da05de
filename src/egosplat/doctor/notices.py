"""What a plan and ``egosplat doctor`` say of scenes before anything is made: small checkpoints on a real recording."""

from collections.abc import Iterable, Mapping, Sequence

from egosplat.errors import UserError
from egosplat.frames.origin import recording_origin
from egosplat.models.suitability import configured_checkpoints, notice
from egosplat.pipeline.config import Config
from egosplat.pipeline.scenes import Scene, Target, is_own
from egosplat.pipeline.variants import variant_config

NAMED = 5
"""So many scenes that are left out are named."""


def scene_notice(scene: Scene, config: Config | None = None) -> str | None:
    """The notice of a scene whose recording is there; None where models and recording fit, or it is not there.

    Args:
        scene: of the table of scenes.
        config: a variant's; None for the scene's own.
    """
    if scene.synthetic or not scene.recording.exists():
        return None
    try:
        origin = recording_origin(scene.format, scene.recording)
    except UserError:
        return None  # the stage frames tells what is wrong with the recording
    return notice(origin, configured_checkpoints(config or scene.config))


def plan_notices(scenes: Mapping[tuple[str, str], Scene], targets: Sequence[Target]) -> list[str]:
    """One line for each different notice of what is asked for, with the names of its scenes.

    Args:
        scenes: all of the table, by dataset and name.
        targets: asked for below ``results``; none stands for every scene.
    """
    found: dict[str, list[str]] = {}
    for name, told in _asked(scenes, targets):
        if told is not None and name not in found.setdefault(told, []):
            found[told].append(name)
    return [f"{', '.join(names)}: {told}" for told, names in found.items()]


def left_out_notices(scenes: Mapping[tuple[str, str], Scene], targets: Sequence[Target]) -> list[str]:
    """A line that names a user's own rows whose recording is not there, where everything is asked for.

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
    return [f"left out, for their recordings are not there: {names}{more}"]


def _asked(
    scenes: Mapping[tuple[str, str], Scene], targets: Sequence[Target]
) -> Iterable[tuple[str, str | None]]:
    if not targets:
        return [(f"{scene.dataset}/{scene.scene}", scene_notice(scene)) for scene in scenes.values()]
    return [_asked_target(scenes[target.dataset, target.scene], target) for target in targets]


def _asked_target(scene: Scene, target: Target) -> tuple[str, str | None]:
    where = f"{scene.dataset}/{scene.scene}"
    if target.variant is None:
        return where, scene_notice(scene)
    config = variant_config(scene.config, target.variant, where)
    return f"{where}, {target.variant}", scene_notice(scene, config)
