"""
Memory, time and GPUs that each job requests: egosplat.pipeline.costs evaluated on the job's inputs.

Snakemake evaluates them again when the inputs exist; a dry run shows <TBD> until then. On one machine one job at a time uses the
GPU; the other requests limit nothing, unless --resources is given.
"""

import shutil

from snakemake.resources import Resources

from egosplat.pipeline import costs


def memory(stage):
    """Get a function of a job: requested memory [MB]."""
    return lambda wildcards, input, attempt: costs.memory_mb(
        stage, config_of(wildcards), input, attempt, is_chunk(wildcards)
    )


def runtime(stage):
    """Get a function of a job: requested time [min]."""
    return lambda wildcards, input, attempt: costs.runtime_min(
        stage, config_of(wildcards), input, attempt, is_chunk(wildcards)
    )


def gpus(stage):
    """Get a function of the wildcards: requested GPUs."""
    return lambda wildcards: costs.gpus(stage, config_of(wildcards))


# Two jobs on one GPU may exceed its memory. A machine without one runs as many jobs as its cores allow.
if workflow.resource_settings.nodes is None and shutil.which("nvidia-smi"):
    if "gpu" not in workflow.resource_settings.resources:
        workflow.global_resources.update(Resources.from_mapping({"gpu": 1}))
