"""
Transient pixels, predicted by a network from what static Gaussians cannot fit, and the instances they belong to.

REQUIRED INPUTS: frames.zarr, poses.zarr, instances.zarr; survey.json, if it may leave frames out. Never annotations.zarr.
OUTPUTS: transient.zarr, masks.zarr. While transient runs, .transient.zarr.checkpoint, from which a killed run resumes.
"""


rule transient:
    """Train the network and temporary Gaussians, and predict the transient probability of all frames."""
    input:
        **configured("transient"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}transient.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}transient.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}transient.tsv"
    threads: 1  # the stage uses one, for reproducible results
    resources:
        **request("transient"),
    params:
        **params("transient"),
        weights=asked(jobs.encoder_weights),
    shell:
        "egosplat transient {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule masks:
    """Select the transient instances, and mask them in every frame."""
    input:
        frames=shared("frames.zarr"),
        transient=shared("transient.zarr"),
        instances=shared("instances.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}masks.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}masks.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}masks.tsv"
    resources:
        **request("masks"),
    params:
        **params("masks"),
    shell:
        "egosplat masks {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
