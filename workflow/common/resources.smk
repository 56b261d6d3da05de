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


# Two jobs on one GPU may exceed its memory. A machine without one runs as many jobs as its cores allow.
if workflow.resource_settings.nodes is None and shutil.which("nvidia-smi"):
    if "gpu" not in workflow.resource_settings.resources:
        workflow.global_resources.update(Resources.from_mapping({"gpu": 1}))


# A dry run and --verbose show Snakemake's own blocks.
if PLAIN_OUTPUT and CALL.makes_results and not workflow.output_settings.verbose:
    # The keys that decide about time are those of the first scene that is asked for.
    first = next(
        (scenes[one.dataset, one.scene] for one in targets), next(iter(scenes.values()))
    )
    PLAIN_OUTPUT.times = StepTimes(
        lambda rule: expected_seconds(rule, first.config, first.synthetic)
    )
