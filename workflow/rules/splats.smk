"""
3D Gaussians of the scene, their language codes, and what is carried among them.

REQUIRED INPUTS: frames.zarr, poses.zarr. By configuration and survey: masks.zarr or transient.zarr, instances.zarr and
features.zarr or tiles.zarr, survey.json; of histories, instances.zarr and view_features.zarr. Never annotations.zarr.
OUTPUTS: splats.zarr, language.zarr, histories.zarr. While a stage runs, .{name}.checkpoint, from which a killed run resumes,
and of a long recording splats.{chunk}.chunk.
"""


rule splats:
    """Train Gaussians on the training frames, and score their renders of the held-out frames."""
    input:
        **configured("splats"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}splats.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}splats.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}splats.tsv"
    threads: 8
    resources:
        **request("splats"),
    params:
        **params("splats"),
        source=asked(jobs.given_splats),
    shell:
        "egosplat splats {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


# A chunk of the Gaussians is one of the survey's cells.
use rule splats as splats_chunk with:
    output:
        temp(directory("results/{dataset}/{scene}/{variant}splats.{chunk}.chunk")),
    log:
        "logs/{dataset}/{scene}/{variant}splats.{chunk}.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}splats.{chunk}.tsv"


rule language:
    """Assign each Gaussian the code of its instance, at every level."""
    input:
        **configured("language"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
        splats=shared("splats.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}language.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}language.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}language.tsv"
    threads: 8
    resources:
        **request("language"),
    params:
        **params("language"),
    shell:
        "egosplat language {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule histories:
    """Find what is carried from where to where, and train Gaussians of what lies somewhere for a while."""
    input:
        **configured("histories"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
        instances=shared("instances.zarr"),
        view_features=shared("view_features.zarr"),
        splats=shared("splats.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}histories.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}histories.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}histories.tsv"
    threads: 8
    resources:
        **request("histories"),
    params:
        **params("histories"),
    shell:
        "egosplat histories {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
