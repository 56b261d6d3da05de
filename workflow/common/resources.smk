"""
Memory, time and GPUs that each job requests: egosplat.cost_model evaluated on the job's inputs.

Snakemake evaluates them again when the inputs exist; a dry run shows <TBD> until then. On one machine the requests limit
nothing, unless --resources is given.
"""

from egosplat.cost_model import requests


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
