"""Inputs, parameters and requests of rules as functions of wildcards: the plain functions in egosplat.run.jobs of a job."""

from snakemake.exceptions import IncompleteCheckpointException

from egosplat.doctor.inputs import scene_notice
from egosplat.pipeline import costs
from egosplat.pipeline.code_hash import code_hash
from egosplat.pipeline.scenes import check_recording
from egosplat.pipeline.stages import STAGES
from egosplat.run import jobs


def wait_for_survey(scene, folder):
    """Let Snakemake make the survey in a folder of a scene, and evaluate the rules again."""
    checkpoints.survey.get(dataset=scene.dataset, scene=scene.scene, variant=folder)


@cache
def scene_named(dataset, scene):
    """Get a scene; if its models suit its recording badly, one line says so, as egosplat run does itself."""
    found = find_scene(scenes, dataset, scene)
    if (told := scene_notice(found)) and workflow.is_main_process and not is_of_run:
        print(f"egosplat: {found.name}: {told}", file=sys.stderr)
    return found


@cache
def job_named(dataset, scene, variant=None, chunk=None):
    """Get the job on a scene or variant."""
    return jobs.Job(scene_named(dataset, scene), variant, chunk, wait_for_survey)


def job_of(wildcards):
    """Get the job of wildcards."""
    variant = wildcards.get("variant", "").removeprefix("variants/").removesuffix("/")
    chunk = wildcards.get("chunk")
    return job_named(wildcards.dataset, wildcards.scene, variant or None, chunk)


def asked(function, *given):
    """Get a function of the wildcards from one whose last argument is a job."""
    return lambda wildcards: or_exit(lambda: function(*given, job_of(wildcards)))


def shared(file):
    """Get the path of an artifact: a variant has its own only where it differs."""
    return asked(jobs.path_of, Path(file).stem)


@asked
def recording(job):
    """Get the recording. Its time does not count: a parameter has the digest of what a stage reads."""
    check_recording(job.scene)
    path = str(job.scene.recording)
    return path if job.scene.synthetic else ancient(path)


def configured(stage):
    """Get the inputs that depend on configuration and survey, for the rule to unpack."""

    def decided(job):
        try:
            paths = jobs.decided_paths(stage, job)
        except IncompleteCheckpointException as lack:
            # A plan shows all that may follow. Each of it waits for the survey, and then is evaluated again.
            paths = jobs.decided_paths(stage, job, possible=True)
            return [*(paths | {"survey": lack.targetfile}).values()]
        if "survey" in paths:
            job.survey  # which is made first
            # Its decisions are parameters of the rule, so a newer file alone must not rerun it.
            paths["survey"] = ancient(paths["survey"])
        return [*paths.values()]

    return {
        "learnt": asked(lambda job: [*jobs.learnt_paths(stage, job).values()]),
        "decided": asked(decided),
        "chunks": asked(jobs.chunk_files, stage),
    }


def params(stage):
    """Get the parameters of a stage, to unpack in its rule; they are words of its command and what makes it stale."""
    functions = jobs.parameters(stage).items()
    return {name: asked(function, stage) for name, function in functions}


def request(stage):
    """Get the memory, time and GPUs that a job requests, for the rule to unpack; they are <TBD> until its inputs exist."""

    def requested(name):
        def value(wildcards, input, attempt):
            job = job_of(wildcards)
            request = costs.request(stage, job.config, input, attempt, bool(job.chunk))
            return request[name]

        return value

    found = {name: requested(name) for name in ("mem_mb", "runtime")}
    if costs.can_use_gpu(stage):
        found["gpu"] = asked(lambda job: costs.gpus(stage, job.config))
    return found


def labels(page):
    """Get the labels of a result in Snakemake's report, unique for each result."""
    return lambda wildcards: {
        "dataset": wildcards.dataset,
        "scene": wildcards.scene,
        "variant": job_of(wildcards).variant or "none",
        "page": page,
    }


@cache
def wanted_scenes():
    """Get the scenes of a run without a target, and name the user's own that lack their recordings."""
    for scene in scenes.values():
        if is_own(scene) and scene.lacks_recording:
            lack = f"no recording at {scene.recording}"
            print(f"egosplat: {scene.name} is skipped: {lack}", file=sys.stderr)
    return default_scenes(scenes.values())


def results_of_scenes(_):
    """Get the results of a run without a target."""
    wanted = or_exit(wanted_scenes)
    return [path for scene in wanted for path in jobs.default_results(scene)]


def surveyed_results(_):
    """Get the pages of scenes whose survey finds motion."""
    wanted = [job_named(s.dataset, s.scene) for s in or_exit(wanted_scenes)]
    return [path for job in wanted for path in jobs.results_by_survey(job)]
