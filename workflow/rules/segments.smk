"""
Instances: what is in the pictures, at three levels, followed through the video.

REQUIRED INPUTS: frames.zarr. Never annotations.zarr.
OUTPUTS: segments.zarr.
TOOLS: SAM2, or OpenCV's graph segmentation and optical flow.
"""


rule segments:
    """Find instances by a grid of point prompts and follow them both ways."""
    input:
        frames=artifact("frames"),
    output:
        directory("results/{dataset}/{scene}/{variant}segments.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}segments.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}segments.tsv"
    threads: 8
    resources:
        mem_mb=24000,
        runtime="24h",
    params:
        flags=flags("segments"),
        code=code_of("segments"),
        models=models("segments"),
    shell:
        "egosplat segments"
        " --frames {input.frames:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
