"""
Inputs and parameters of the rules, from plain functions in egosplat.pipeline of a configuration and a survey.

The parameters of a rule hold the flags of its stage and the content hash of its code and models: Snakemake reruns it
when one of them changes. Functions of (dataset, scene, variant) are cached, because every rule calls them.
"""

from egosplat.frames.files import (
    annotations_files,
    digest_of_files,
    frames_files,
    pictures_of,
)
from egosplat.frames.recording_files import is_annotated
from egosplat.models.checkpoints import model_hashes
from egosplat.pipeline import dag
from egosplat.pipeline.chosen import chosen_value
from egosplat.pipeline.results import default_results, default_scenes
from egosplat.pipeline.scenes import check_recording
from egosplat.pipeline.stages import STAGES, code_of
from egosplat.pipeline.survey_file import read_survey
from egosplat.pipeline.variants import (
    artifact_folder,
    artifact_path,
    method_of,
    scene_config,
)
from egosplat.poses.files import poses_files


def variant_in(folder):
    """Get the name of the variant in its folder below the scene's; None for the scene itself."""
    return folder.split("/")[1] if folder else None


def names_of(wildcards):
    """Get (dataset, scene, variant); the variant is None for the scene itself."""
    variant = variant_in(wildcards.get("variant"))
    return wildcards.dataset, wildcards.scene, variant


def scene_of(wildcards):
    """Get the row of the table of scenes."""
    return find_scene(scenes, wildcards.dataset, wildcards.scene)


@cache
def config_named(dataset, scene, variant):
    """Get the configuration of a scene or a variant."""
    return scene_config(find_scene(scenes, dataset, scene), variant)


def config_of(wildcards):
    """Get the configuration of the scene or variant."""
    return config_named(*names_of(wildcards))


@cache
def path_named(stage, dataset, scene, variant):
    """Get the path of an artifact, the variant's own or a shared one."""
    return artifact_path(stage, find_scene(scenes, dataset, scene), variant)


def artifact(stage):
    """Get a function of the wildcards: the path of a stage's artifact."""
    return lambda wildcards: path_named(stage, *names_of(wildcards))


def survey_named(dataset, scene, variant):
    """Read the survey of a scene or variant. Snakemake makes it first and then evaluates the rules again."""
    folder = artifact_folder("survey", find_scene(scenes, dataset, scene), variant)
    checkpoints.survey.get(dataset=dataset, scene=scene, variant=folder)
    return read_survey(Path(path_named("survey", dataset, scene, variant)))


def decided_config(wildcards):
    """Get the configuration with the survey's decisions. It waits for the survey only if the survey decides something."""
    config = config_of(wildcards)
    if not dag.survey_decides(config):
        return config
    return dag.decided(config, survey_named(*names_of(wildcards)))


def training_frames(stage):
    """Get a function of the wildcards: the digest of the frames that a stage trains on."""

    def digest(wildcards):
        config = config_of(wildcards)
        if not dag.leaves_frames_out(config):
            return dag.ALL_FRAMES
        return dag.training_frames(stage, config, survey_named(*names_of(wildcards)))

    return digest


def optional_paths(stage, wildcards):
    """Get the paths of the optional inputs that the configuration needs, by stage."""
    names = dag.optional_inputs_of(stage, decided_config(wildcards))
    return {name: path_named(name, *names_of(wildcards)) for name in names}


def optional_artifacts(stage):
    """Get a function of the wildcards: the optional inputs of a stage, without those of `learnt_artifacts`."""

    def paths(wildcards):
        learnt, every = learnt_paths(stage, wildcards), optional_paths(stage, wildcards)
        found = {name: path for name, path in every.items() if name not in learnt}
        if "survey" in found:
            survey_named(*names_of(wildcards))
            # The decisions of a survey are parameters of the rule, so a newer file alone must not rerun it.
            found["survey"] = ancient(found["survey"])
        return list(found.values())

    return paths


def learnt_paths(stage, wildcards):
    """Get the paths of what codes are learnt from, by stage. A plan made before the survey knows them."""
    names = dag.learnt_from(stage, config_of(wildcards))
    return {name: path_named(name, *names_of(wildcards)) for name in names}


def learnt_artifacts(stage):
    """Get a function of the wildcards: what codes are learnt from, as far as a stage reads it."""
    return lambda wildcards: list(learnt_paths(stage, wildcards).values())


def learnt_flags(stage):
    """Get a function of the wildcards: what codes are learnt from, as command line flags."""
    return lambda wildcards: dag.input_flags(learnt_paths(stage, wildcards))


def optional_flags(stage):
    """Get a function of the wildcards: the optional inputs as command line flags."""
    return lambda wildcards: dag.input_flags(optional_paths(stage, wildcards))


def flags(stage):
    """Get a function of the wildcards: the keys of a stage as command line flags."""
    get_config = decided_config if dag.follows_survey(stage) else config_of
    return lambda wildcards: dag.stage_flags(stage, get_config(wildcards))


def models(stage):
    """Get a function of the wildcards: content hashes of a stage's models."""

    def hashes(wildcards):
        found = model_hashes(config_of(wildcards))
        return " ".join(
            f"{key}={found[key]}" for key in STAGES[stage].models if key in found
        )

    return hashes


def code_of_chosen(stage):
    """Get a function of the wildcards: the hash of a stage's code with the module that it chooses."""
    return lambda wildcards: code_of(stage, value_of(stage, wildcards))


def value_of(stage, wildcards):
    """Get the value by which a stage chooses its module."""
    return chosen_value(stage, scene_of(wildcards), config_of(wildcards))


def recording_files(stage):
    """Get a function of the wildcards: the files of the recording that a stage opens, without pictures of folders."""

    def paths(wildcards):
        scene, config = scene_of(wildcards), config_of(wildcards)
        if scene.synthetic:  # one folder, which a rule makes
            return [str(scene.recording)]
        check_recording(scene)
        known = config["frames"]["known_poses"]
        if stage == "frames":
            found = frames_files(scene.format, scene.recording, known)
        elif stage == "annotations":
            found = annotations_files(scene.format, scene.recording)
        else:
            source, trajectory = (
                value_of(stage, wildcards),
                config["poses"]["trajectory"],
            )
            found = poses_files(source, scene.recording, trajectory, known)
        # Snakemake reads braces as wildcards.
        return [str(path) for path in found if not set("{}") & set(str(path))]

    return paths


def pictures(stage):
    """
    Get a function of the wildcards: a digest of the pictures of a folder that a stage opens.

    A folder's time of change does not tell of a file in it that is overwritten, and thousands of inputs take Snakemake long.
    """

    def digest(wildcards):
        scene = scene_of(wildcards)
        if scene.synthetic:
            return "none"
        return digest_of_files(pictures_of(stage, scene.format, scene.recording))

    return digest


def get_recording(wildcards):
    """Get the path of the scene's recording."""
    return str(scene_of(wildcards).recording)


def get_title(wildcards):
    """Get the name of the scene or variant in pages and tables."""
    variant = names_of(wildcards)[2]
    name = scene_of(wildcards).name
    return f"{name}, {variant}" if variant else name


def method_flag(wildcards):
    """Get the published method that a variant stands for as a command line flag; empty for EgoSplat."""
    variant = names_of(wildcards)[2]
    scene = scene_of(wildcards)
    name = variant and method_of(scene.config, variant, scene.name)
    return f"--method {shlex.quote(name)}" if name else ""


def labels(page):
    """Get a function of the wildcards: the labels of a result in Snakemake's report, unique for each result."""
    return lambda wildcards: {
        "dataset": wildcards.dataset,
        "scene": wildcards.scene,
        "variant": names_of(wildcards)[2] or "none",
        "page": page,
    }


def results_of_scenes(_):
    """Get the results of a run without a target. A report takes only those that exist."""
    wanted = [
        path
        for scene in default_scenes(scenes.values())
        for path in default_results(scene)
    ]
    if not CALL.reports:
        return wanted
    found = [path for path in wanted if os.path.exists(path)]
    if not found:
        sys.exit(
            "egosplat: no scene has results to report; make some: snakemake --cores 2 results/DATASET/SCENE/metrics.json"
        )
    return found


def surveyed_results(_):
    """Get transient.png of the scenes whose survey finds motion."""
    asked = [
        scene
        for scene in default_scenes(scenes.values())
        if dag.masks_by_survey(scene.config)
    ]
    if CALL.reports:
        paths = [str(scene.results / "transient.png") for scene in asked]
        return [path for path in paths if os.path.exists(path)]
    surveys = [
        (scene, survey_named(scene.dataset, scene.scene, None)) for scene in asked
    ]
    return [
        str(scene.results / "transient.png")
        for scene, survey in surveys
        if survey["motion"]["masking"] == "refined"
    ]
