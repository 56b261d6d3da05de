"""
Frames of a recording, and annotations for evaluation only.

REQUIRED INPUTS: the recording (ADT sequence, HOI4D sequence, video or folder of images).
OUTPUTS: recording/ (synthetic apartment only), frames.zarr, annotations.zarr.
TOOLS: projectaria-tools, OpenCV; trimesh and Embree for the synthetic apartment.
"""


def is_recording_annotated(wildcards):
    """Tell whether a plain recording has annotations. Without them all frames train."""
    scene = scene_of(wildcards)
    return is_annotated(scene.format, scene.recording)


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
        flags=flags("synthetic"),
        code=code_of("synthetic"),
    shell:
        "egosplat synthetic"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule frames:
    """Read and rectify the recording's frames, and split them into training and evaluation."""
    input:
        recording_files("frames"),
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
        recording=get_recording,
        format=lambda wildcards: scene_of(wildcards).format,
        annotated=is_recording_annotated,
        flags=flags("frames"),
        pictures=pictures("frames"),
        code=code_of_chosen("frames"),
    shell:
        "egosplat frames"
        " --recording {params.recording:q}"
        " --format {params.format}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule annotations:
    """Read the instance maps of the evaluation frames. No training rule may depend on them."""
    input:
        recording_files("annotations"),
        frames=artifact("frames"),
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
        recording=get_recording,
        flags=flags("annotations"),
        pictures=pictures("annotations"),
        code=code_of_chosen("annotations"),
    shell:
        "egosplat annotations"
        " --recording {params.recording:q}"
        " --frames {input.frames:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
