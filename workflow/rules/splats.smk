"""
The scene as 3D Gaussians.

REQUIRED INPUTS: frames.zarr, poses.zarr. Never annotations.zarr.
OUTPUTS: splats.zarr; beside it, while it is made, .splats.zarr.checkpoint, from which a killed run goes on.
TOOLS: PyTorch, egosplat's kernels or gsplat, torchmetrics.
"""


rule splats:
    """Train Gaussians on the training frames, and measure how well they render the held-out ones."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        poses="results/{dataset}/{scene}/poses.zarr",
    output:
        directory("results/{dataset}/{scene}/splats.zarr"),
    log:
        "logs/{dataset}/{scene}/splats.log",
    benchmark:
        "logs/{dataset}/{scene}/splats.tsv"
    threads: 8
    resources:
        mem_mb=16000,
        runtime="24h",
    params:
        flags=flags("splats"),
        code=code_of("splats"),
    shell:
        "egosplat splats"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
