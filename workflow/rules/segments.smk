"""
Instances at three levels, tracked through the video.

REQUIRED INPUTS: frames.zarr; survey.json, if it may leave frames out. Never annotations.zarr.
OUTPUTS: segments.zarr.
TOOLS: SAM2, or OpenCV's graph segmentation and optical flow.
"""


rule segments:
    """Find instances with a grid of point prompts, and track them forwards and backwards."""
    input:
        frames=artifact("frames"),
        others=optional_artifacts("segments"),
    output:
        directory("results/{dataset}/{scene}/{variant}segments.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}segments.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}segments.tsv"
    threads: 8
    resources:
        mem_mb=memory("segments"),
        runtime=runtime("segments"),
        gpu=gpus("segments"),
    params:
        others=optional_flags("segments"),
        kept=training_frames("segments"),
        flags=flags("segments"),
        code=code_of("segments"),
        models=models("segments"),
    shell:
        "egosplat segments"
        " --frames {input.frames:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
