"""
Configuration, the table of scenes, and what every rule's parameters are made of.

A stage's parameters hold its command line flags (its own keys alone) and the content hash of the code that
it executes: Snakemake reruns it when one of them changes, and not when something else does.
"""

import json
import os
import shlex
import sys
from glob import glob
from pathlib import Path

from egosplat import config as configuration
from egosplat.errors import UserError
from egosplat.models.checkpoints import model_hashes
from egosplat.scenes import check_recording, find_scene, read_scenes, requested_targets
from egosplat.stages import STAGES, code_of
from egosplat.variants import optional_inputs_of, reaches, variant_config


def check_target(target):
    """Check that what the command line asks for can be made, before Snakemake looks for a rule."""
    scene = find_scene(scenes, target.dataset, target.scene)
    check_recording(scene)
    if target.variant is None:
        return
    own = variant_config(scene.config, target.variant, f"{scene.dataset}/{scene.scene}")
    stage, _, suffix = target.name.partition(".")
    named = stage in STAGES and suffix in ("zarr", "json")
    if named and not reaches(stage, scene.config, own):
        raise UserError(
            f"variant {target.variant} changes nothing of {target.name}; take {scene.results / target.name}"
        )


try:
    presets = Path(workflow.basedir).parent / "config" / "presets"
    scenes = read_scenes(configuration.resolve(config, presets))
    for target in requested_targets(sys.argv):
        check_target(target)
except UserError as error:
    # Not as an exception, around which Snakemake would print a traceback.
    sys.exit(f"egosplat: {error}")


# The commands of the environment that Snakemake itself runs in, activated or not. A prefix replaces
# Snakemake's own, which makes a command fail that fails before its pipe to the log.
shell.prefix(
    "set -euo pipefail; "
    f"export PATH={shlex.quote(os.path.dirname(sys.executable))}:$PATH; "
)


LABELS = {"dataset": "{dataset}", "scene": "{scene}", "variant": "{variant}"}
"""Of a picture in Snakemake's report."""


wildcard_constraints:
    dataset="[a-z0-9_]+",
    scene="[A-Za-z0-9_-]+",
    variant="(variants/[A-Za-z0-9_-]+/)?",


def scene_of(wildcards):
    """The row of the table of scenes."""
    return find_scene(scenes, wildcards.dataset, wildcards.scene)


def config_of(wildcards):
    """The scene's configuration, with the variant's keys over it."""
    base = scene_of(wildcards).config
    if not wildcards.get("variant"):
        return base
    name = wildcards.variant.split("/")[1]
    return variant_config(base, name, f"{wildcards.dataset}/{wildcards.scene}")


def title(wildcards):
    """What the scene is called in pictures and tables."""
    name = f"{wildcards.dataset}/{wildcards.scene}"
    variant = wildcards.get("variant")
    return f"{name}, {variant.split('/')[1]}" if variant else name


def path_of(stage, wildcards):
    """The artifact of a stage: the variant's own where one of its keys reaches the stage, else the scene's."""
    own = reaches(stage, scene_of(wildcards).config, config_of(wildcards))
    variant = wildcards.get("variant", "") if own else ""
    return f"results/{wildcards.dataset}/{wildcards.scene}/{variant}{stage}.zarr"


def artifact(stage):
    """A function of the wildcards: the artifact of a stage."""
    return lambda wildcards: path_of(stage, wildcards)


def optional_artifacts(stage):
    """A function of the wildcards: the artifacts that a stage reads as its keys ask for it."""

    def paths(wildcards):
        names = optional_inputs_of(stage, config_of(wildcards))
        return [path_of(name, wildcards) for name in names]

    return paths


def optional_flags(stage):
    """A function of the wildcards: the same as command line flags."""

    def flags_of_scene(wildcards):
        names = optional_inputs_of(stage, config_of(wildcards))
        return " ".join(
            f"--{name.replace('_', '-')} {shlex.quote(path_of(name, wildcards))}"
            for name in names
        )

    return flags_of_scene


def flags(stage):
    """A function of the wildcards: the stage's keys as command line flags, in order of their names."""

    def flags_of_scene(wildcards):
        keys = configuration.stage_values(stage, config_of(wildcards))
        return " ".join(
            flag(name, value)
            for name, value in sorted(keys.items())
            if value is not None
        )

    return flags_of_scene


def models(stage):
    """A function of the wildcards: what the files of a stage's models hold, so that another checkpoint is seen."""

    def models_of_scene(wildcards):
        hashes = model_hashes(config_of(wildcards))
        return " ".join(
            f"{key}={hashes[key]}" for key in STAGES[stage].models if key in hashes
        )

    return models_of_scene


def flag(name, value):
    """One key as a command line flag."""
    name = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{name}" if value else f"--no-{name}"
    text = json.dumps(value) if isinstance(value, list) else str(value)
    return f"--{name} {shlex.quote(text)}"


def recording(wildcards):
    """Path of the scene's recording."""
    return str(scene_of(wildcards).recording)


def recording_format(wildcards):
    """How the scene's recording is laid out on disk."""
    return scene_of(wildcards).format


def recording_files(stage):
    """A function of the wildcards: the files of the recording that a stage reads, so that a change is seen.

    A synthetic recording is one folder, made by a rule. Of a real one, what exists is watched: the stage
    itself says best what is missing.
    """

    def files_of_scene(wildcards):
        scene = scene_of(wildcards)
        if scene.synthetic:
            return [str(scene.recording)]
        check_recording(scene)
        if not scene.recording.is_dir():
            return [str(scene.recording)]
        patterns = WATCHED[scene.format][stage]
        return sorted(
            path
            for pattern in patterns
            for path in glob(os.path.join(scene.recording, pattern))
        )

    return files_of_scene


WATCHED = {
    "adt": {
        "frames": ["video.vrs", "metadata.json"],
        "annotations": ["segmentations*.vrs", "instances.json"],
        "poses": ["aria_trajectory.csv", "mps/slam/*.csv*"],
    },
    "hoi4d": {
        "frames": ["align_rgb/image.mp4"],
        "annotations": ["2Dseg/*mask"],
        "poses": [],
    },
    # The folder's own time tells of pictures that come and go.
    "plain": {
        "frames": [".", "camera.json", "valid.png"],
        "annotations": ["annotations"],
        "poses": [],
    },
}
"""Of each format, what a stage reads."""


def results_of_scenes(_):
    """The pictures and scores of every scene whose recording is there or can be made."""
    return [
        str(scene.results / name) for scene in available() for name in results_of(scene)
    ]


def available():
    """The scenes whose recording is there or can be made."""
    return [
        scene
        for scene in scenes.values()
        if scene.synthetic or scene.recording.exists()
    ]


def results_of(scene):
    """Of one scene; what moves is shown where it is masked by instances."""
    names = ["contact_sheet.png", "segments.png", "crops.png"]
    if scene.config["splats"]["masking"] == "refined":
        names.append("transient.png")
    return [*names, "splats.png", "language.png", "metrics.json"]
