"""
Memory, time and GPUs that each job requests: egosplat.cost_model evaluated on the job's inputs.

Snakemake evaluates them again when the inputs exist; a dry run shows <TBD> until then. On one machine one job at a time uses the
GPU; the other requests limit nothing, unless --resources is given.
"""

import shutil

from snakemake.resources import Resources

from egosplat.cost_model import requests
from egosplat.cost_model.expected import expected_seconds


def memory(stage):
    """Get a function of a job: requested memory [MB]."""
    return lambda wildcards, input, attempt: requests.memory_mb(
        stage, config_of(wildcards), input, attempt
    )


def runtime(stage):
    """Get a function of a job: requested time [min]."""
    return lambda wildcards, input, attempt: requests.runtime_min(
        stage, config_of(wildcards), input, attempt
    )


def gpus(stage):
    """Get a function of the wildcards: requested GPUs."""
    return lambda wildcards: requests.gpus(stage, config_of(wildcards))


@cache
def time_of_step(step):
    """Get the expected time of a step [s], with the keys of its scene or variant."""
    names = dict(step.wildcards)
    if "scene" not in names:  # of all scenes together
        scene = next(iter(scenes.values()))
        return expected_seconds(step.rule, scene.config, scene.synthetic)
    dataset, scene = names["dataset"], names["scene"]
    variant = variant_in(names.get("variant"))
    synthetic = find_scene(scenes, dataset, scene).synthetic
    return expected_seconds(step.rule, config_named(dataset, scene, variant), synthetic)


def planned_steps():
    """Get the steps of this run."""
    jobs = workflow.dag.needrun_jobs(exclude_finished=False)
    return [Step.of(job.rule.name, job.wildcards_dict) for job in jobs]


# Two jobs on one GPU may exceed its memory. A machine without one runs as many jobs as its cores allow.
if workflow.resource_settings.nodes is None and shutil.which("nvidia-smi"):
    if "gpu" not in workflow.resource_settings.resources:
        workflow.global_resources.update(Resources.from_mapping({"gpu": 1}))


# A dry run and --verbose show Snakemake's own blocks.
if PLAIN_OUTPUT and CALL.makes_results and not workflow.output_settings.verbose:
    PLAIN_OUTPUT.times = StepTimes(time_of_step, planned_steps)
