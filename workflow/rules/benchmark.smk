"""
How well a scene is found, outlined and rendered.

REQUIRED INPUTS: frames.zarr, poses.zarr, annotations.zarr, features.zarr, splats.zarr, language.zarr; what these were
made from is looked at beside them, for its time and memory.
OUTPUTS: metrics.json, as src/egosplat/schemas/metrics.schema.yaml describes it.
TOOLS: OpenCLIP, PyTorch, egosplat's kernels or gsplat, torchmetrics.
"""


rule metrics:
    """Ask for everything that is annotated in the evaluation frames, and score answers and renders."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        annotations=artifact("annotations"),
        features=artifact("features"),
        splats=artifact("splats"),
        language=artifact("language"),
    output:
        "results/{dataset}/{scene}/{variant}metrics.json",
    log:
        "logs/{dataset}/{scene}/{variant}metrics.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}metrics.tsv"
    threads: 8
    resources:
        mem_mb=8000,
        runtime="2h",
    params:
        title=title,
        flags=flags("metrics"),
        models=models("metrics"),
        code=code_of("metrics"),
    shell:
        "egosplat metrics"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --annotations {input.annotations:q}"
        " --features {input.features:q}"
        " --splats {input.splats:q}"
        " --language {input.language:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
