"""
Configuration, the table of scenes, and what every shell command begins with.
"""

import os
import shlex
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

from egosplat.pipeline import config as configuration
from egosplat.errors import UserError
from egosplat.pipeline.process_guards import STARTED_BY
from egosplat.doctor.notices import left_out_notices, plan_notices
from egosplat.pipeline.scenes import (
    check_recording,
    find_scene,
    read_scenes,
    requested_targets,
)
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.process_guards import clear_stale_locks
from egosplat.tradeoff.points import points_of, with_points
from egosplat.pipeline.variants import owner, variant_config


def check_target(target):
    """Check that what the command line asks for can be made, before Snakemake looks for a rule."""
    scene = find_scene(scenes, target.dataset, target.scene)
    check_recording(scene)
    where = f"{scene.dataset}/{scene.scene}"
    if target.variant is None:
        if target.name.startswith("tradeoff/"):
            points_of(scene.config, where)
        return
    variant_config(scene.config, target.variant, where)
    stage, _, suffix = target.name.partition(".")
    if stage not in STAGES or suffix not in ("zarr", "json"):
        return
    home = folder_of(stage, scene, target.variant)
    if home != folder_of_variant(target.variant):
        raise UserError(
            f"variant {target.variant} changes nothing of {target.name}; take {scene.results}/{home}{target.name}"
        )


def folder_of(stage, scene, variant):
    """Where a variant's artifact of a stage lies, below the scene's own folder."""
    where = f"{scene.dataset}/{scene.scene}"
    return folder_of_variant(owner(stage, scene.config, variant, where))


def folder_of_variant(variant):
    """The folder of a variant, below the scene's; none of the scene itself."""
    return f"variants/{variant}/" if variant else ""


def scene_with_points(scene):
    """A scene with the variants that its trade of speed against accuracy is made of."""
    return replace(scene, config=with_points(scene.config, presets, scene.format))


try:
    presets = Path(workflow.basedir).parent / "config" / "presets"
    scenes = read_scenes(configuration.resolve(config, presets))
    scenes = {key: scene_with_points(scene) for key, scene in scenes.items()}
    targets = requested_targets(sys.argv)
    for target in targets:
        check_target(target)
except UserError as error:
    # Not as an exception, around which Snakemake would print a traceback.
    sys.exit(f"egosplat: {error}")

# The plan's first line: of jobs it would be said again by each.
if workflow.is_main_process:
    for line in [*plan_notices(scenes, targets), *left_out_notices(scenes, targets)]:
        print(f"egosplat: {line}", file=sys.stderr)


# A killed command can say nothing itself. Whatever becomes of the line, the command's own status stays.
TELL_IF_KILLED = str(Path(workflow.basedir) / "scripts/tell_if_killed.sh")
AT_EXIT = f"sh {shlex.quote(TELL_IF_KILLED)} $? || true"

# The commands of the environment that Snakemake itself runs in, activated or not. A prefix replaces
# Snakemake's own, which makes a command fail that fails before its pipe to the log.
shell.prefix(
    "set -euo pipefail; "
    f"trap {shlex.quote(AT_EXIT)} EXIT; "
    f"export PATH={shlex.quote(os.path.dirname(sys.executable))}:$PATH; "
    f"export {STARTED_BY}=$PPID; "
)

# A Snakemake that was killed leaves its locks: the same command is to go on without --unlock. Not on a cluster,
# where what it submitted runs on; --jobs, the number of such jobs, is all that tells at this moment.
if workflow.is_main_process and workflow.resource_settings.nodes is None:
    if clear_stale_locks(Path(".snakemake")):
        print("The last Snakemake here was killed: going on.", file=sys.stderr)


wildcard_constraints:
    dataset="[a-z0-9_]+",
    scene="[A-Za-z0-9_-]+",
    variant="(variants/[A-Za-z0-9_-]+/)?",


def scene_of(wildcards):
    """The row of the table of scenes."""
    return find_scene(scenes, wildcards.dataset, wildcards.scene)


def config_of(wildcards):
    """The scene's configuration, with the variant's keys over it."""
    return config_of_variant(wildcards.dataset, wildcards.scene, variant_of(wildcards))


@cache
def config_of_variant(dataset, scene, variant):
    """The same by names; every rule of a variant asks for it many times."""
    base = find_scene(scenes, dataset, scene).config
    return variant_config(base, variant, f"{dataset}/{scene}") if variant else base


def variant_of(wildcards):
    """The variant's name; None of the scene itself."""
    folder = wildcards.get("variant")
    return folder.split("/")[1] if folder else None


def labels(page):
    """A function of the wildcards: what tells a result from all others in Snakemake's report, a row of it each."""

    def of_result(wildcards):
        return {
            "dataset": wildcards.dataset,
            "scene": wildcards.scene,
            "variant": variant_of(wildcards) or "none",
            "page": page,
        }

    return of_result


def title(wildcards):
    """What the scene is called in pictures and tables."""
    name = f"{wildcards.dataset}/{wildcards.scene}"
    variant = variant_of(wildcards)
    return f"{name}, {variant}" if variant else name
