"""
OpenCLIP features of each instance: per view, aggregated over the views, and compressed to codes. OpenCLIP features of tiles
of frames, for methods that use no masks.

REQUIRED INPUTS: frames.zarr, instances.zarr. Never annotations.zarr.
OUTPUTS: view_features.zarr, features.zarr, tiles.zarr. While view_features and tiles run, .view_features.zarr.checkpoint and
.tiles.zarr.checkpoint, from which a killed run resumes. Of a long recording, {stage}.{chunk}.chunk, which the stage gathers; temporary.
TOOLS: OpenCLIP, PyTorch; SAM2 for tiles.
"""


rule view_features:
    """Encode the crop of each instance in each training frame with OpenCLIP."""
    input:
        **inputs("view_features"),
    output:
        directory("results/{dataset}/{scene}/{variant}view_features.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}view_features.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}view_features.tsv"
    threads: 8
    resources:
        mem_mb=memory("view_features"),
        runtime=runtime("view_features"),
        gpu=gpus("view_features"),
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
        **inputs("features"),
    output:
        directory("results/{dataset}/{scene}/{variant}features.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}features.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}features.tsv"
    threads: 1  # the autoencoder uses one, for reproducible results
    resources:
        mem_mb=memory("features"),
        runtime=runtime("features"),
    params:
        **params("features"),
    shell:
        "egosplat features {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule tiles:
    """Encode the tiles of each training frame with OpenCLIP, for the methods of others that need them."""
    input:
        **inputs("tiles"),
    output:
        directory("results/{dataset}/{scene}/{variant}tiles.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}tiles.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}tiles.tsv"
    threads: 8
    resources:
        mem_mb=8000,
        runtime=240,
        gpu=gpus("tiles"),
    params:
        **params("tiles"),
    shell:
        "egosplat tiles {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


use rule tiles as tiles_chunk with:
    output:
        temp("results/{dataset}/{scene}/{variant}tiles.{chunk}.chunk"),
    log:
        "logs/{dataset}/{scene}/{variant}tiles.{chunk}.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}tiles.{chunk}.tsv"
