"""
What each job asks a cluster for. The laws are in src/egosplat/cluster; here they get a job's inputs.

A job's memory and time follow the shapes of its inputs, which Snakemake asks for again when they are there: a dry run
shows <TBD> before. On one machine nothing of it limits anything, unless --resources says so.
"""

from egosplat.cluster import requests
from egosplat.cluster.shapes import Shapes


def memory(stage):
    """A function of a job: the memory that it asks for [MB]."""
    return lambda wildcards, input, attempt: requests.memory_mb(
        stage, config_of(wildcards), Shapes(input), attempt
    )


def runtime(stage):
    """A function of a job: the time that it asks for [min]."""
    return lambda wildcards, input, attempt: requests.runtime_min(
        stage, config_of(wildcards), Shapes(input), attempt
    )


def gpus(stage):
    """A function of the wildcards: the GPUs that a job asks for."""
    return lambda wildcards: requests.gpus(stage, config_of(wildcards))
