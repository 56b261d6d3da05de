"""
Masks at three levels, and the instances they show: tracked through the video, or merged in 3D.

REQUIRED INPUTS: frames.zarr, poses.zarr. By configuration and survey: transient.zarr, if moving things are tracked;
splats.zarr, if masks are merged on its Gaussians; survey.json. Never annotations.zarr.
OUTPUTS: segments.zarr, instances.zarr. Until then .{name}.checkpoint, and of a long recording segments.{chunk}.chunk.
"""


rule segments:
    """Find instances with a grid of point prompts, and track them forwards and backwards."""
    input:
        **configured("segments"),
        frames=shared("frames.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}segments.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}segments.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}segments.tsv"
    threads: 8
    resources:
        **request("segments"),
    params:
        **params("segments"),
    shell:
        "egosplat segments {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


use rule segments as segments_chunk with:
    output:
        temp("results/{dataset}/{scene}/{variant}segments.{chunk}.chunk"),
    log:
        "logs/{dataset}/{scene}/{variant}segments.{chunk}.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}segments.{chunk}.tsv"


rule instances:
    """Merge masks on Gaussians, the scene's or temporary ones, into instances that hold in 3D."""
    input:
        **configured("instances"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
        segments=shared("segments.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}instances.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}instances.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}instances.tsv"
    threads: 1  # the stage uses one, for reproducible results
    resources:
        **request("instances"),
    params:
        **params("instances"),
    shell:
        "egosplat instances {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
