"""
Inputs and parameters of the rules, from plain functions in egosplat.pipeline of a configuration and a survey.

Parameters hold the options of a stage and the content hash of its code and models: Snakemake reruns the stage when one of them
changes. Functions of (dataset, scene, variant) are cached, because every rule calls them.
"""

from egosplat.calibration.files import digest_of_recording, is_annotated, source_files
from egosplat.models.checkpoints import content_hash, joint_hash, model_hashes
from egosplat.pipeline import dag
from egosplat.pipeline.config import stage_sections
from egosplat.pipeline.home import snakemake_in
from egosplat.pipeline.results import (
    default_results,
    default_scenes,
    results_by_survey,
)
from egosplat.pipeline.scenes import check_recording
from egosplat.pipeline.stages import STAGES, code_of
from egosplat.pipeline.survey_file import read_survey
from egosplat.pipeline.variants import (
    artifact_folder,
    artifact_path,
    chosen_value,
    method_of,
    preset_of,
    scene_config,
)


def names_of(wildcards):
    """Get (dataset, scene, variant); the variant is None for the scene itself."""
    folder = wildcards.get("variant")
    return wildcards.dataset, wildcards.scene, folder.split("/")[1] if folder else None


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


@cache
def survey_folder(dataset, scene, variant):
    """Get the folder, below the scene's, of the survey of a scene or variant."""
    return artifact_folder("survey", find_scene(scenes, dataset, scene), variant)


@cache
def survey_at(path, written):
    """Read a survey that was written at a time [ns]."""
    return read_survey(Path(path))


def survey_named(dataset, scene, variant):
    """Read the survey of a scene or variant. Snakemake makes it first and then evaluates the rules again."""
    folder = survey_folder(dataset, scene, variant)
    checkpoints.survey.get(dataset=dataset, scene=scene, variant=folder)
    path = path_named("survey", dataset, scene, variant)
    return survey_at(path, os.stat(path).st_mtime_ns if os.path.exists(path) else None)


def decided_config(wildcards):
    """Get the configuration with the survey's decisions. It waits for the survey only if the survey decides something."""
    config = config_of(wildcards)
    if not dag.decided_by_survey(config):
        return config
    return dag.decide(config, survey_named(*names_of(wildcards)))


def required_paths(stage, wildcards):
    """Get the paths of the inputs that a stage always reads, by name; a recording is one folder or video file."""
    scene, names = scene_of(wildcards), STAGES[stage].inputs
    given = {"recording": str(scene.recording)}
    return {
        name: given.get(name) or path_named(name, *names_of(wildcards))
        for name in names
    }


def learnt_paths(stage, wildcards):
    """Get the paths of what codes are learnt from, by stage. A plan made before the survey knows them."""
    names = dag.learnt_from(stage, config_of(wildcards))
    return {name: path_named(name, *names_of(wildcards)) for name in names}


def decided_paths(stage, wildcards):
    """Get the paths of the optional inputs that the survey may decide, by stage."""
    names = dag.optional_inputs_of(stage, decided_config(wildcards))
    other = {*learnt_paths(stage, wildcards)}
    if is_chunk(wildcards):  # what moves is tracked by the job that gathers
        other.add("transient")
    return {
        name: path_named(name, *names_of(wildcards))
        for name in names
        if name not in other
    }


def is_chunk(wildcards):
    """Tell whether a job works on a chunk of the frames alone."""
    return "chunk" in wildcards.keys()


def chunk_files(stage):
    """Get a function of the wildcards: the results of chunks that a job gathers; none where it does the work itself.

    As with Snakemake's scattergather, whose number of parts is the same for all scenes; the survey knows the frames of each.
    """

    def paths(wildcards):
        config = config_of(wildcards)
        if is_chunk(wildcards) or not dag.is_surveyed(config):
            return []
        count = dag.count_chunks(stage, config, survey_named(*names_of(wildcards)))
        folder = "results/{dataset}/{scene}/{variant}".format(**wildcards)
        return [f"{folder}{stage}.{number}.chunk" for number in range(1, count + 1)]

    return paths


def inputs(stage):
    """Get the inputs of a stage's rule as functions of the wildcards, for the rule to unpack."""

    def decided(wildcards):
        paths = decided_paths(stage, wildcards)
        if "survey" in paths:
            survey_named(*names_of(wildcards))
            # The decisions of a survey are parameters of the rule, so a newer file alone must not rerun it.
            paths["survey"] = ancient(paths["survey"])
        return list(paths.values())

    def required(name):
        if name == "recording":
            return recording_path
        return lambda wildcards: required_paths(stage, wildcards)[name]

    found = {name: required(name) for name in STAGES[stage].inputs}
    if STAGES[stage].optional:
        found["learnt"] = lambda wildcards: [*learnt_paths(stage, wildcards).values()]
        found["decided"] = decided
    if STAGES[stage].by_chunks:
        found["chunks"] = chunk_files(stage)
    return found


def params(stage):
    """Get the parameters of a stage's rule as functions of the wildcards, for the rule to unpack.

    ``arguments`` are the paths of its inputs and its values from the table of scenes, as words of the command line,
    ``options`` the values of its keys as JSON. The others are not for the command: Snakemake reruns the rule when the list of
    training frames, the models, the code or the recording change.
    """
    about = STAGES[stage]
    get_config = decided_config if dag.follows_survey(stage) else config_of

    def arguments(wildcards):
        paths = required_paths(stage, wildcards) | learnt_paths(stage, wildcards)
        if about.optional:
            paths |= decided_paths(stage, wildcards)
        values = {name: SCENE_VALUES[name](wildcards) for name in about.scene}
        values |= {"chunk": wildcards.get("chunk")}
        flags = dag.input_flags(paths | {n: v for n, v in values.items() if v})
        chunks = chunk_files(stage)(wildcards) if about.by_chunks else ()
        return " ".join([flags, *(f"--gather {shlex.quote(path)}" for path in chunks)])

    found = {
        "arguments": arguments,
        "options": lambda wildcards: dag.options_json(stage, get_config(wildcards)),
        "code": code_of(stage),
    }
    if about.modules:
        found["code"] = lambda wildcards: code_of(stage, value_of(stage, wildcards))
    if "recording" in about.inputs:
        found["recording"] = recording_digest(stage)
    if "survey" in about.optional:
        found["kept"] = training_frames(stage)
    if keys := stage_sections(stage).get("models"):
        found["models"] = model_files(keys)
    return found


def training_frames(stage):
    """Get a function of the wildcards: the digest of the frames that a stage trains on."""

    def digest(wildcards):
        config = config_of(wildcards)
        if not dag.leaves_frames_out(config):  # there may be no survey
            return dag.ALL_FRAMES
        return dag.training_frames(stage, config, survey_named(*names_of(wildcards)))

    return digest


@cache
def models_named(dataset, scene, variant):
    """Get the hashes of the models of a scene or variant."""
    return model_hashes(config_named(dataset, scene, variant))


def model_files(keys):
    """Get a function of the wildcards: content hashes of the models of keys."""

    def hashes(wildcards):
        found = models_named(*names_of(wildcards))
        return " ".join(f"{key}={found[key]}" for key in keys if key in found)

    return hashes


def value_of(stage, wildcards):
    """Get the value by which a stage chooses its module."""
    return chosen_value(stage, scene_of(wildcards), config_of(wildcards))


def recording_path(wildcards):
    """Get the recording, one folder or video file. Its time does not count: a parameter has the digest of what a stage reads."""
    scene = scene_of(wildcards)
    path = str(scene.recording)
    if scene.synthetic:  # a rule makes it
        return [path]
    check_recording(scene)
    # HOI4D's sequences have names that are no folder.
    return [ancient(path)] if os.path.exists(path) else []


def recording_digest(stage):
    """Get a function of the wildcards: the digest of all files of the recording that a stage reads."""

    def digest(wildcards):
        scene = scene_of(wildcards)
        if scene.synthetic:
            return "none"
        return digest_of_recording(
            stage, scene.format, scene.recording, config_of(wildcards)
        )

    return digest


def encoder_weights(wildcards):
    """Get a hash of the encoder's weights, so that a changed file reruns the rule. The stage reports a missing file."""
    name = config_of(wildcards)["transient"]["encoder_weights"]
    path = Path(name).expanduser() if name else None
    return content_hash(path)[:16] if path and path.is_file() else "none"


def source_content(wildcards):
    """Get a hash of the Gaussians of another program, as above."""
    source = config_of(wildcards)["splats"]["source"]
    try:
        return joint_hash(source_files(source)) if source else "none"
    except UserError:
        return "none"


def is_recording_annotated(wildcards):
    """Tell whether a plain recording has annotations. Without them all frames train."""
    scene = scene_of(wildcards)
    return is_annotated(scene.format, scene.recording)


def get_title(wildcards):
    """Get the name of the scene or variant in pages and tables."""
    variant = names_of(wildcards)[2]
    name = scene_of(wildcards).name
    return f"{name}, {variant}" if variant else name


def get_method(wildcards):
    """Get the published method that a variant stands for; None for EgoSplat."""
    variant = names_of(wildcards)[2]
    scene = scene_of(wildcards)
    return variant and method_of(scene.config, variant, scene.name)


def get_preset(wildcards):
    """Get the preset of a scene or variant."""
    scene = scene_of(wildcards)
    return preset_of(scene.config, names_of(wildcards)[2], scene.name)


def get_world(key):
    """Get a function of the wildcards: a key of a scene's synthetic apartment; None for a recording."""

    def value(wildcards):
        scene = scene_of(wildcards)
        return str(scene.config["synthetic"][key]) if scene.synthetic else None

    return value


# What a stage takes from the table of scenes and the variant, by name of its argument.
SCENE_VALUES = {
    "title": get_title,
    "method": get_method,
    "preset": get_preset,
    "world_seed": get_world("seed"),
    "camera": get_world("camera"),
    "format": lambda wildcards: scene_of(wildcards).format,
}


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
            f"egosplat: no scene has results to report; make some: {snakemake_in(Path())} --cores 2 results/DATASET/SCENE/metrics.json"
        )
    return found


def surveyed_results(_):
    """Get transient.png and carries.png of the scenes whose survey finds motion."""
    asked = [
        scene
        for scene in default_scenes(scenes.values())
        if not {("splats", "masking"), ("segments", "track_moving")}.isdisjoint(
            dag.decided_by_survey(scene.config)
        )
    ]
    if CALL.reports:
        pages = [STAGES[name].output for name in ("transient_sheet", "carries_sheet")]
        paths = [str(scene.results / page) for scene in asked for page in pages]
        return [path for path in paths if os.path.exists(path)]
    surveys = [
        (scene, survey_named(scene.dataset, scene.scene, None)) for scene in asked
    ]
    return [path for pair in surveys for path in results_by_survey(*pair)]
