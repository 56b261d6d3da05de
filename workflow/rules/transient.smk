"""
Transient pixels, predicted by a network from what static Gaussians cannot fit, and the instances they belong to.

REQUIRED INPUTS: frames.zarr, poses.zarr, instances.zarr; survey.json, if it may leave frames out. Never annotations.zarr.
OUTPUTS: transient.zarr, masks.zarr. While transient runs, .transient.zarr.checkpoint, from which a killed run resumes.
TOOLS: PyTorch, timm, egosplat's kernels or gsplat.
"""

from egosplat.models.checkpoints import content_hash


def encoder_weights(wildcards):
    """Get a hash of the encoder's weights, so that a changed file reruns the rule. The stage reports a missing file."""
    name = config_of(wildcards)["transient"]["encoder_weights"]
    path = Path(name).expanduser() if name else None
    return content_hash(path)[:16] if path and path.is_file() else "none"


rule transient:
    """Train the network and temporary Gaussians, and predict the transient probability of all frames."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        others=optional_artifacts("transient"),
    output:
        directory("results/{dataset}/{scene}/{variant}transient.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}transient.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}transient.tsv"
    threads: 1  # the stage uses one, for reproducible results
    resources:
        mem_mb=memory("transient"),
        runtime=runtime("transient"),
        gpu=gpus("transient"),
    params:
        others=optional_flags("transient"),
        kept=training_frames("transient"),
        flags=flags("transient"),
        weights=encoder_weights,
        code=code_of("transient"),
    shell:
        "egosplat transient"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule masks:
    """Select the transient instances, and mask them in every frame."""
    input:
        frames=artifact("frames"),
        transient=artifact("transient"),
        instances=artifact("instances"),
    output:
        directory("results/{dataset}/{scene}/{variant}masks.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}masks.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}masks.tsv"
    threads: 1
    resources:
        mem_mb=memory("masks"),
        runtime=runtime("masks"),
    params:
        flags=flags("masks"),
        code=code_of("masks"),
    shell:
        "egosplat masks"
        " --frames {input.frames:q}"
        " --transient {input.transient:q}"
        " --instances {input.instances:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
