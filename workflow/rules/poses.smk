"""
Camera poses, and the points that initialize the Gaussians.

REQUIRED INPUTS: frames.zarr; for ADT the recording's trajectory and points; known poses of a plain recording.
OUTPUTS: poses.zarr.
"""


rule poses:
    """Get the pose of every frame from the device's trajectory, a file, or COLMAP."""
    input:
        recording=recording,
        frames=shared("frames.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}poses.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}poses.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}poses.tsv"
    threads: 8
    resources:
        **request("poses"),
    params:
        **params("poses"),
    shell:
        "egosplat poses {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
