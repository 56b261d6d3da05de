"""What the rules of the workflow ask: inputs and parameters of a job, from its scene, its configuration and its survey.

Snakemake reruns a job when a parameter changes: options, code, models, the list of training frames or the recording."""

import functools
import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from egosplat.calibration.files import digest_of_recording, is_annotated, source_files
from egosplat.files import expand_home
from egosplat.models.checkpoints import content_hash, joint_hash, model_hashes
from egosplat.pipeline import dag
from egosplat.pipeline.config import Config, stage_sections
from egosplat.pipeline.scenes import Scene
from egosplat.pipeline.stages import STAGES, code_of
from egosplat.pipeline.survey_file import Survey
from egosplat.pipeline.validation import read_document
from egosplat.pipeline.variants import artifact_path, chosen_value, method_of, preset_of, scene_config


@dataclass(frozen=True, eq=False)
class Job:
    """A scene, or its ``variant``, on which a stage works, alone on the ``chunk`` of frames of that number; ``wait`` waits
    until the survey in a folder of the scene is made."""

    scene: Scene
    variant: str | None = None
    chunk: str | None = None
    wait: Callable[[Scene, str], object] = lambda scene, folder: None

    @functools.cached_property
    def config(self) -> Config:
        """The configuration (UserError: no such variant, or the Gaussians of another program are missing)."""
        config = scene_config(self.scene, self.variant)
        if source := config["splats"]["source"]:
            source_files(source)
        return config

    @property
    def decided(self) -> Config:
        """The configuration with the survey's decisions, if it decides something."""
        return dag.decide(self.config, self.survey) if dag.decided_by_survey(self.config) else self.config

    @property
    def survey(self) -> Survey:
        """The survey. Snakemake makes it first, and then evaluates the rules again."""
        path = path_of("survey", self)
        folder = path.removeprefix(f"{self.scene.results}/").removesuffix("survey.json")
        self.wait(self.scene, folder)
        return _survey_at(path, os.stat(path).st_mtime_ns)

    @functools.cached_property
    def models(self) -> dict[str, str]:
        """Hashes of the models by key."""
        return model_hashes(self.config)


@functools.cache
def _survey_at(path: str, _written_ns: int) -> Survey:
    return read_document(Path(path), "survey")


@functools.cache
def path_of(stage: str, job: Job) -> str:
    """Get the path of an artifact, the variant's own or a shared one."""
    return artifact_path(stage, job.scene, job.variant)


def learnt_paths(stage: str, job: Job) -> dict[str, str]:
    """Get the paths of what codes are learnt from, by stage. No survey decides them."""
    return {name: path_of(name, job) for name in dag.learnt_from(stage, job.config)}


def decided_paths(stage: str, job: Job, possible: bool = False) -> dict[str, str]:
    """Get the paths of the other optional inputs, by stage, that the survey decides, or may, if it also decides the frames."""
    if not STAGES[stage].optional or (possible and not dag.leaves_frames_out(job.config)):
        return {}
    # What moves is tracked by the job that gathers the chunks.
    later = ["transient"] if job.chunk and stage == "segments" else []
    others = {*dag.learnt_from(stage, job.config), *later}
    names = dag.optional_inputs_of(stage, job.config if possible else job.decided)
    return {name: path_of(name, job) for name in names if name not in others}


def chunk_files(stage: str, job: Job) -> list[str]:
    """Get the results of chunks that a job gathers; none where it does the work itself. The survey knows the frames."""
    if job.chunk or not STAGES[stage].by_chunks or not dag.is_surveyed(job.config):
        return []
    own = Path(job.scene.results, "variants", job.variant) if job.variant else job.scene.results
    count = dag.count_chunks(stage, job.config, job.survey)
    return [f"{own}/{stage}.{number}.chunk" for number in range(1, count + 1)]


def parameters(stage: str) -> dict[str, Callable[[str, Job], str]]:
    """Get the functions of the parameters of a stage's rule, by name, each of the stage and a job.

    ``arguments`` and ``options`` are words of the command, the others make the job stale."""
    about = STAGES[stage]
    functions = {"arguments": arguments, "options": options}
    functions["code"] = lambda stage, job: code_of(stage, chosen_value(stage, job.scene, job.config))
    if "recording" in about.inputs:
        functions["recording"] = _recording
    if "survey" in about.optional:
        functions["kept"] = _training_frames
    if keys := stage_sections(stage).get("models"):
        functions["models"] = lambda stage, job: " ".join(
            f"{key}={job.models[key]}" for key in keys if key in job.models
        )
    return functions


def arguments(stage: str, job: Job) -> str:
    """Format the paths of a stage's inputs, and its values from the table of scenes, as flags of its command."""
    recording = str(job.scene.recording)
    flags = {name: recording if name == "recording" else path_of(name, job) for name in STAGES[stage].inputs}
    flags |= learnt_paths(stage, job) | decided_paths(stage, job)
    flags |= {name: value for name in STAGES[stage].scene if (value := scene_value(name, job))}
    flags |= {"chunk": job.chunk} if job.chunk else {}
    words = [f"--{name.replace('_', '-')} {shlex.quote(value)}" for name, value in flags.items()]
    return " ".join([*words, *(f"--gather {shlex.quote(path)}" for path in chunk_files(stage, job))])


def scene_value(name: str, job: Job) -> str | None:
    """Get what a stage takes from the table of scenes and the variant, by name of its argument."""
    scene = job.scene
    if name == "title":
        return f"{scene.name}, {job.variant}" if job.variant else scene.name
    if name == "method":
        return method_of(scene.config, job.variant, scene.name) if job.variant else None
    if name == "preset":
        return preset_of(scene.config, job.variant, scene.name)
    if name == "format":
        return scene.format
    return str(scene.config["synthetic"][name.removeprefix("world_")]) if scene.synthetic else None


def options(stage: str, job: Job) -> str:
    """Format the values of a stage's keys as JSON, sorted by name."""
    return dag.options_json(stage, job.decided if dag.follows_survey(stage) else job.config)


def _training_frames(stage: str, job: Job) -> str:
    """Get the digest of the frames that a stage trains on."""
    surveyed = "survey" in dag.optional_inputs_of(stage, job.config)  # else there may be no survey
    return dag.training_frames(stage, job.config, job.survey) if surveyed else dag.ALL_FRAMES


def _recording(stage: str, job: Job) -> str:
    """Get the digest of all files of the recording that a stage reads."""
    recording = job.scene.format, job.scene.recording
    return "none" if job.scene.synthetic else digest_of_recording(stage, *recording, job.config)


def encoder_weights(job: Job) -> str:
    """Get a hash of the weights of the encoder of ``transient``, which reports a missing file."""
    path = expand_home(job.config["transient"]["encoder_weights"] or "")
    return content_hash(path)[:16] if path.is_file() else "none"


def given_splats(job: Job) -> str:
    """Get a hash of the Gaussians of another program."""
    source = job.config["splats"]["source"]
    return joint_hash(source_files(source)) if source else "none"


def has_annotations(job: Job) -> bool:
    """Whether a plain recording has annotations. Without them all frames train."""
    return is_annotated(job.scene.format, job.scene.recording)


def story_files(job: Job) -> list[str]:
    """Get the outputs that the story of a scene or variant tells of."""
    stages = dag.story_stages(job.decided, has_annotations(job), dag.is_surveyed(job.config))
    return [path_of(stage, job) for stage in stages]


def default_results(scene: Scene) -> list[str]:
    """Get the paths that a run without a target makes for a scene, except those that its survey decides."""
    return [str(scene.results / name) for name in dag.default_pages(scene.config)]


def results_by_survey(job: Job) -> list[str]:
    """Get the paths that such a run makes for a scene because its survey finds motion."""
    scene = job.scene
    if {("splats", "masking"), ("segments", "track_moving")}.isdisjoint(dag.decided_by_survey(scene.config)):
        return []
    pages, known = dag.default_pages(dag.decide(scene.config, job.survey)), default_results(scene)
    return [path for page in pages if (path := str(scene.results / page)) not in known]
