"""
Pictures for people.

REQUIRED INPUTS: frames.zarr, annotations.zarr, poses.zarr, segments.zarr, view_features.zarr, features.zarr,
splats.zarr.
OUTPUTS: contact_sheet.png, segments.png, crops.png, splats.png.
TOOLS: matplotlib.
"""


rule contact_sheet:
    """Draw a scene's pictures, its annotations, and its trajectory and points from above."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        annotations="results/{dataset}/{scene}/annotations.zarr",
        poses="results/{dataset}/{scene}/poses.zarr",
    output:
        report(
            "results/{dataset}/{scene}/contact_sheet.png",
            caption="../report/contact_sheet.rst",
            category="Scenes",
            labels={"dataset": "{dataset}", "scene": "{scene}"},
        ),
    log:
        "logs/{dataset}/{scene}/contact_sheet.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=code_of("contact_sheet"),
    shell:
        "egosplat contact-sheet"
        " --frames {input.frames:q}"
        " --annotations {input.annotations:q}"
        " --poses {input.poses:q}"
        " --title {wildcards.dataset}/{wildcards.scene}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule segments_sheet:
    """Draw the instances of each level in frames through the video."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        segments="results/{dataset}/{scene}/segments.zarr",
    output:
        report(
            "results/{dataset}/{scene}/segments.png",
            caption="../report/segments.rst",
            category="Scenes",
            labels={"dataset": "{dataset}", "scene": "{scene}"},
        ),
    log:
        "logs/{dataset}/{scene}/segments_sheet.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=code_of("segments_sheet"),
    shell:
        "egosplat segments-sheet"
        " --frames {input.frames:q}"
        " --segments {input.segments:q}"
        " --title {wildcards.dataset}/{wildcards.scene}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule crops_sheet:
    """Draw crops of instances in order of time, the views that were left out struck out."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        segments="results/{dataset}/{scene}/segments.zarr",
        view_features="results/{dataset}/{scene}/view_features.zarr",
        features="results/{dataset}/{scene}/features.zarr",
    output:
        report(
            "results/{dataset}/{scene}/crops.png",
            caption="../report/crops.rst",
            category="Scenes",
            labels={"dataset": "{dataset}", "scene": "{scene}"},
        ),
    log:
        "logs/{dataset}/{scene}/crops_sheet.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=code_of("crops_sheet"),
    shell:
        "egosplat crops-sheet"
        " --frames {input.frames:q}"
        " --segments {input.segments:q}"
        " --view-features {input.view_features:q}"
        " --features {input.features:q}"
        " --title {wildcards.dataset}/{wildcards.scene}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule splats_sheet:
    """Draw held-out frames beside their renders, and how training went."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        splats="results/{dataset}/{scene}/splats.zarr",
    output:
        report(
            "results/{dataset}/{scene}/splats.png",
            caption="../report/splats.rst",
            category="Scenes",
            labels={"dataset": "{dataset}", "scene": "{scene}"},
        ),
    log:
        "logs/{dataset}/{scene}/splats_sheet.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=code_of("splats_sheet"),
    shell:
        "egosplat splats-sheet"
        " --frames {input.frames:q}"
        " --splats {input.splats:q}"
        " --title {wildcards.dataset}/{wildcards.scene}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"
