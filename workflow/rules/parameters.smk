"""
What every rule's inputs and parameters are made of.

A stage's parameters hold its command line flags (its own keys alone) and the content hash of the code that
it executes: Snakemake reruns it when one of them changes, and not when something else does.
"""

import json

from egosplat.pipeline.survey_file import gaussians_learn_from_all
from egosplat.pipeline.survey_file import read_survey
from egosplat.pipeline.dag import decided, leaves_frames_out, masks_by_survey
from egosplat.models.checkpoints import model_hashes
from egosplat.pipeline.stages import code_of
from egosplat.pipeline.variants import optional_inputs_of


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


def frames_for_gaussians(wildcards):
    """The same of the frames that Gaussians are trained on."""
    config = decided_config(wildcards)
    if leaves_frames_out(config) and gaussians_learn_from_all(
        survey_of(wildcards), config["splats"]["masking"]
    ):
        return "all"
    return decided_frames(wildcards)


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
