"""
The scene as 3D Gaussians.

REQUIRED INPUTS: frames.zarr, poses.zarr; as configured or surveyed, masks.zarr or transient.zarr, segments.zarr and
features.zarr, survey.json. Never annotations.zarr.
OUTPUTS: splats.zarr, language.zarr; beside each, while it is made, .{name}.checkpoint, from which a killed run goes on.
TOOLS: PyTorch, egosplat's kernels or gsplat.
"""


rule splats:
    """Train Gaussians on the training frames, and measure how well they render the held-out ones."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        others=optional_artifacts("splats"),
    output:
        directory("results/{dataset}/{scene}/{variant}splats.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}splats.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}splats.tsv"
    threads: 8
    resources:
        mem_mb=memory("splats"),
        runtime=runtime("splats"),
        gpu=gpus("splats"),
    params:
        others=optional_flags("splats"),
        kept=training_frames("splats"),
        flags=flags("splats"),
        code=code_of("splats"),
    shell:
        "egosplat splats"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule language:
    """Give each Gaussian the codes of what it shows, at every level."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        segments=artifact("segments"),
        features=artifact("features"),
        splats=artifact("splats"),
        others=optional_artifacts("language"),
    output:
        directory("results/{dataset}/{scene}/{variant}language.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}language.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}language.tsv"
    threads: 8
    resources:
        mem_mb=memory("language"),
        runtime=runtime("language"),
        gpu=gpus("language"),
    params:
        others=optional_flags("language"),
        kept=training_frames("language"),
        flags=flags("language"),
        code=code_of("language"),
    shell:
        "egosplat language"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --segments {input.segments:q}"
        " --features {input.features:q}"
        " --splats {input.splats:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
