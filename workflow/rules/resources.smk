"""
Memory, time and GPUs that each job asks a cluster for: egosplat.cost_model evaluated on the job's inputs.

Snakemake asks again when the inputs exist; a dry run shows <TBD> before. On one machine the requests limit nothing,
unless --resources is given.
"""

from egosplat.cost_model import requests


def memory(stage):
    """Function of a job: memory to ask for [MB]."""
    return lambda wildcards, input, attempt: requests.memory_mb(
        stage, config_of(wildcards), input, attempt
    )


def runtime(stage):
    """Function of a job: time to ask for [min]."""
    return lambda wildcards, input, attempt: requests.runtime_min(
        stage, config_of(wildcards), input, attempt
    )


def gpus(stage):
    """Function of the wildcards: GPUs to ask for."""
    return lambda wildcards: requests.gpus(stage, config_of(wildcards))
