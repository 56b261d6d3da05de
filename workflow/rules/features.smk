"""
OpenCLIP features of each instance: per view, aggregated over the views, and compressed to codes.

REQUIRED INPUTS: frames.zarr, instances.zarr. Never annotations.zarr.
OUTPUTS: view_features.zarr, features.zarr. While view_features runs, .view_features.zarr.checkpoint, from which a killed run
resumes. Of a long recording, {stage}.{chunk}.chunk, which the stage gathers; temporary.
"""


rule view_features:
    """Encode the crop of each instance in each training frame with OpenCLIP."""
    input:
        **configured("view_features"),
        frames=shared("frames.zarr"),
        instances=shared("instances.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}view_features.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}view_features.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}view_features.tsv"
    threads: 8
    resources:
        **request("view_features"),
    params:
        **params("view_features"),
    shell:
        "egosplat view-features {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


use rule view_features as view_features_chunk with:
    output:
        temp("results/{dataset}/{scene}/{variant}view_features.{chunk}.chunk"),
    log:
        "logs/{dataset}/{scene}/{variant}view_features.{chunk}.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}view_features.{chunk}.tsv"


rule features:
    """Aggregate each instance's features over its views, and compress them to codes."""
    input:
        view_features=shared("view_features.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}features.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}features.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}features.tsv"
    threads: 1  # the autoencoder uses one, for reproducible results
    resources:
        **request("features"),
    params:
        **params("features"),
    shell:
        "egosplat features {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
