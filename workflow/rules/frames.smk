"""
Frames of a recording, and annotations for evaluation only.

REQUIRED INPUTS: the recording (ADT sequence, HOI4D sequence, video or folder of images).
OUTPUTS: recording/ (synthetic apartment only), frames.zarr, annotations.zarr.
TOOLS: projectaria-tools, OpenCV; trimesh and Embree for the synthetic apartment.
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
        mem_mb=memory("synthetic"),
        runtime=runtime("synthetic"),
    params:
        **params("synthetic"),
    shell:
        "egosplat synthetic {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule frames:
    """Read and rectify the recording's frames, and split them into training and evaluation."""
    input:
        **inputs("frames"),
    output:
        directory("results/{dataset}/{scene}/{variant}frames.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}frames.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}frames.tsv"
    resources:
        mem_mb=memory("frames"),
        runtime=runtime("frames"),
    params:
        **params("frames"),
        annotated=is_recording_annotated,
    shell:
        "egosplat frames {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule annotations:
    """Read the instance maps of the evaluation frames. No training rule may depend on them."""
    input:
        **inputs("annotations"),
    output:
        directory("results/{dataset}/{scene}/{variant}annotations.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}annotations.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}annotations.tsv"
    resources:
        mem_mb=memory("annotations"),
        runtime=runtime("annotations"),
    params:
        **params("annotations"),
    shell:
        "egosplat annotations {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
