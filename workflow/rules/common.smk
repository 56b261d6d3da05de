"""
Configuration, the table of scenes, and what every rule's parameters are made of.

A stage's parameters hold its command line flags (its own keys alone) and the content hash of the code that
it executes: Snakemake reruns it when one of them changes, and not when something else does.
"""

import json
import os
import shlex
import sys
from dataclasses import replace
from functools import cache
from glob import escape, glob
from pathlib import Path

from egosplat import config as configuration
from egosplat.artifacts.survey import read_survey
from egosplat.decisions import decided, leaves_frames_out, masks_by_survey
from egosplat.errors import UserError
from egosplat.models.checkpoints import model_hashes
from egosplat.orphans import STARTED_BY
from egosplat.scenes import check_recording, find_scene, read_scenes, requested_targets
from egosplat.stages import STAGES, code_of
from egosplat.stale_locks import clear_stale_locks
from egosplat.tradeoff.points import points_of, with_points
from egosplat.variants import optional_inputs_of, owner, variant_config


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
    return replace(scene, config=with_points(scene.config, presets))


try:
    presets = Path(workflow.basedir).parent / "config" / "presets"
    scenes = read_scenes(configuration.resolve(config, presets))
    scenes = {key: scene_with_points(scene) for key, scene in scenes.items()}
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
    f"export {STARTED_BY}=$PPID; "
)

# A Snakemake that was killed leaves its locks: the same command is to go on without --unlock. Not on a cluster,
# where what it submitted runs on.
if workflow.is_main_process and workflow.local_exec and not workflow.dryrun:
    if clear_stale_locks(Path(".snakemake")):
        print("The last Snakemake here was killed: going on.", file=sys.stderr)


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


def title(wildcards):
    """What the scene is called in pictures and tables."""
    name = f"{wildcards.dataset}/{wildcards.scene}"
    variant = variant_of(wildcards)
    return f"{name}, {variant}" if variant else name


def path_of(stage, wildcards):
    """The artifact of a stage: the variant's own where one of its keys reaches the stage, else what it shares."""
    return path_of_variant(
        stage, wildcards.dataset, wildcards.scene, variant_of(wildcards)
    )


@cache
def path_of_variant(stage, dataset, scene, variant):
    """The same by names."""
    found = find_scene(scenes, dataset, scene)
    folder = folder_of(stage, found, variant) if variant else ""
    suffix = "json" if stage in ("survey", "metrics") else "zarr"
    return f"{found.results}/{folder}{stage}.{suffix}"


def artifact(stage):
    """A function of the wildcards: the artifact of a stage."""
    return lambda wildcards: path_of(stage, wildcards)


def survey_of(wildcards):
    """What the scene's survey found, or the variant's own; Snakemake makes it first where it is not there."""
    return survey_of_variant(wildcards.dataset, wildcards.scene, variant_of(wildcards))


def survey_of_variant(dataset, scene, variant):
    """The same by names."""
    path = path_of_variant("survey", dataset, scene, variant)
    folder = path.removeprefix(f"results/{dataset}/{scene}/").removesuffix(
        "survey.json"
    )
    checkpoints.survey.get(dataset=dataset, scene=scene, variant=folder)
    return read_survey(Path(path))


def decided_config(wildcards):
    """The same as ``config_of`` with what the survey decides in place of auto."""
    config = config_of(wildcards)
    return decided(config, survey_of(wildcards)) if masks_by_survey(config) else config


def decided_frames(wildcards):
    """Digest of the frames that learn, so that a survey that keeps others is seen, and no other."""
    if not leaves_frames_out(config_of(wildcards)):
        return "all"
    return survey_of(wildcards)["views"]["digest"]


def optional_artifacts(stage):
    """A function of the wildcards: the artifacts that a stage reads as its keys, and the survey, ask for it."""

    def paths(wildcards):
        names = optional_inputs_of(stage, decided_config(wildcards))
        if "survey" in names:
            decided_frames(wildcards)
        return [followed(name, wildcards) for name in names]

    return paths


def followed(name, wildcards):
    """The path of an artifact. A survey that was made again reruns nothing by itself: its decisions are parameters."""
    path = path_of(name, wildcards)
    return ancient(path) if name == "survey" else path


def optional_flags(stage):
    """A function of the wildcards: the same as command line flags."""

    def flags_of_scene(wildcards):
        names = optional_inputs_of(stage, decided_config(wildcards))
        return " ".join(
            f"--{name.replace('_', '-')} {shlex.quote(path_of(name, wildcards))}"
            for name in names
        )

    return flags_of_scene


def flags(stage):
    """A function of the wildcards: the stage's keys as command line flags, in order of their names."""

    def flags_of_scene(wildcards):
        config = (
            decided_config(wildcards) if stage == "splats" else config_of(wildcards)
        )
        keys = configuration.stage_values(stage, config)
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
        # What belongs to a video lies beside it: clip.mp4.camera.json.
        within = "/" if scene.recording.is_dir() else "."
        found = [
            path
            for pattern in WATCHED[scene.format][stage]
            for path in glob(escape(str(scene.recording)) + within + pattern)
        ]
        if not scene.recording.is_dir():
            found.append(str(scene.recording))
        # The folder itself not as "folder/.", which Snakemake takes for missing. Braces it takes for its own.
        return sorted(
            os.path.normpath(path) for path in found if not set("{}") & set(path)
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
    # A folder's own time tells of files that come and go, not of one that is written anew in its place.
    "plain": {
        "frames": [".", "camera.json", "valid.png"],
        "annotations": ["annotations", "annotations/*"],
        "poses": [],
    },
}
"""Of each format, what a stage reads."""


def results_of_scenes(_):
    """The pictures and scores of every scene whose recording is there or can be made."""
    return [
        str(scene.results / name) for scene in available() for name in results_of(scene)
    ]


def surveyed_results(_):
    """Of the scenes whose survey decides what is masked: the picture of what moves, where something does."""
    asked = [scene for scene in available() if masks_by_survey(scene.config)]
    return [
        str(scene.results / "transient.png")
        for scene in asked
        if survey_masks(scene) == "refined"
    ]


def survey_masks(scene):
    """What a scene's survey says of masking."""
    return survey_of_variant(scene.dataset, scene.scene, None)["motion"]["masking"]


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
    return [*names, "splats.png", "language.png", "metrics.json", "queries.png"]
