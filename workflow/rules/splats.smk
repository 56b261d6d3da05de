"""
3D Gaussians of the scene, and their language codes.

REQUIRED INPUTS: frames.zarr, poses.zarr. By configuration and survey: masks.zarr or transient.zarr, instances.zarr and
features.zarr or tiles.zarr, survey.json. Never annotations.zarr.
OUTPUTS: splats.zarr, language.zarr. While a stage runs, .{name}.checkpoint, from which a killed run resumes.
TOOLS: PyTorch, egosplat's kernels or gsplat.
"""


rule splats:
    """Train Gaussians on the training frames, and score their renders of the held-out frames."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        learnt=learnt_artifacts("splats"),
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
    """Assign each Gaussian the code of its instance, at every level."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        splats=artifact("splats"),
        learnt=learnt_artifacts("language"),
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
        code=code_of_chosen("language"),
    shell:
        "egosplat language"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --splats {input.splats:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
