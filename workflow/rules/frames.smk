"""
Frames of a recording, and annotations for evaluation only.

REQUIRED INPUTS: the recording (ADT sequence, HOI4D sequence, video or folder of images).
OUTPUTS: recording/ (synthetic apartment only), frames.zarr, annotations.zarr.
"""


rule synthetic:
    """Make a synthetic apartment's recording in ADT's format."""
    output:
        directory("results/{dataset}/{scene}/recording"),
    log:
        "logs/{dataset}/{scene}/synthetic.log",
    benchmark:
        "logs/{dataset}/{scene}/synthetic.tsv"
    threads: 2  # each renders frames of its own, and needs memory for one
    resources:
        **request("synthetic"),
    params:
        **params("synthetic"),
    shell:
        "egosplat synthetic {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule frames:
    """Read and rectify the recording's frames, and split them into training and evaluation."""
    input:
        recording=recording,
    output:
        directory("results/{dataset}/{scene}/{variant}frames.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}frames.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}frames.tsv"
    resources:
        **request("frames"),
    params:
        **params("frames"),
        annotated=asked(jobs.has_annotations),
    shell:
        "egosplat frames {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule annotations:
    """Read the instance maps of the evaluation frames. No training rule may depend on them."""
    input:
        recording=recording,
        frames=shared("frames.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}annotations.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}annotations.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}annotations.tsv"
    resources:
        **request("annotations"),
    params:
        **params("annotations"),
    shell:
        "egosplat annotations {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
