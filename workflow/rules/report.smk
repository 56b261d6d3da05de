"""
Figures of a scene, and the scene as one page that answers queries.

REQUIRED INPUTS: frames.zarr, annotations.zarr, poses.zarr, segments.zarr, view_features.zarr, features.zarr,
tiles.zarr, transient.zarr, masks.zarr, splats.zarr, language.zarr, metrics.json.
OUTPUTS: contact_sheet.png, instances.png, crops.png, splats.png, transient.png, language.png, queries.png, methods.png,
scene.html, story.html.
TOOLS: matplotlib; egosplat's kernels or gsplat; OpenCLIP; Jinja.
"""

from egosplat.pipeline.code_hash import code_hash
from egosplat.pipeline.results import compared_methods


def get_story_files(wildcards):
    """Get the outputs that the story of a scene or variant tells of."""
    config = config_of(wildcards)
    surveyed = dag.survey_decides(config) or dag.leaves_frames_out(config)
    annotated = is_recording_annotated(wildcards)
    stages = dag.story_stages(decided_config(wildcards), annotated, surveyed)
    return [path_named(stage, *names_of(wildcards)) for stage in stages]


rule contact_sheet:
    """Draw a scene's frames and annotations, and its trajectory and points from above."""
    input:
        frames=artifact("frames"),
        annotations=artifact("annotations"),
        poses=artifact("poses"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}contact_sheet.png",
            caption="../report/contact_sheet.rst",
            category="Scenes",
            labels=labels("recording"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}contact_sheet.log",
    resources:
        mem_mb=memory("contact_sheet"),
        runtime=runtime("contact_sheet"),
    params:
        title=get_title,
        code=code_of("contact_sheet"),
    shell:
        "egosplat contact-sheet"
        " --frames {input.frames:q}"
        " --annotations {input.annotations:q}"
        " --poses {input.poses:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule instances_sheet:
    """Draw the instances of each level in frames and from above, and crops before and after merging."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        segments=artifact("segments"),
        instances=artifact("instances"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}instances.png",
            caption="../report/instances.rst",
            category="Scenes",
            labels=labels("instances"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}instances_sheet.log",
    resources:
        mem_mb=memory("instances_sheet"),
        runtime=runtime("instances_sheet"),
    params:
        title=get_title,
        code=code_of("instances_sheet"),
    shell:
        "egosplat instances-sheet"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --segments {input.segments:q}"
        " --instances {input.instances:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule crops_sheet:
    """Draw crops of instances in order of time, with outlier views crossed out."""
    input:
        frames=artifact("frames"),
        instances=artifact("instances"),
        view_features=artifact("view_features"),
        features=artifact("features"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}crops.png",
            caption="../report/crops.rst",
            category="Scenes",
            labels=labels("crops"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}crops_sheet.log",
    resources:
        mem_mb=memory("crops_sheet"),
        runtime=runtime("crops_sheet"),
    params:
        title=get_title,
        code=code_of("crops_sheet"),
    shell:
        "egosplat crops-sheet"
        " --frames {input.frames:q}"
        " --instances {input.instances:q}"
        " --view-features {input.view_features:q}"
        " --features {input.features:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule splats_sheet:
    """Draw held-out frames next to their renders, and the training curves."""
    input:
        frames=artifact("frames"),
        splats=artifact("splats"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}splats.png",
            caption="../report/splats.rst",
            category="Scenes",
            labels=labels("renders"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}splats_sheet.log",
    resources:
        mem_mb=memory("splats_sheet"),
        runtime=runtime("splats_sheet"),
    params:
        title=get_title,
        code=code_of("splats_sheet"),
    shell:
        "egosplat splats-sheet"
        " --frames {input.frames:q}"
        " --splats {input.splats:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule transient_sheet:
    """Draw transient probability, masks, and the renders without the masked objects."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        transient=artifact("transient"),
        instances=artifact("instances"),
        masks=artifact("masks"),
        splats=artifact("splats"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}transient.png",
            caption="../report/transient.rst",
            category="Scenes",
            labels=labels("what moves"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}transient_sheet.log",
    resources:
        mem_mb=memory("transient_sheet"),
        runtime=runtime("transient_sheet"),
    params:
        title=get_title,
        code=code_of("transient_sheet"),
    shell:
        "egosplat transient-sheet"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --transient {input.transient:q}"
        " --instances {input.instances:q}"
        " --masks {input.masks:q}"
        " --splats {input.splats:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule language_sheet:
    """Draw the Gaussians' codes from several directions, at each level."""
    input:
        poses=artifact("poses"),
        splats=artifact("splats"),
        language=artifact("language"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}language.png",
            caption="../report/language.rst",
            category="Scenes",
            labels=labels("language"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}language_sheet.log",
    resources:
        mem_mb=memory("language_sheet"),
        runtime=runtime("language_sheet"),
    params:
        title=get_title,
        code=code_of("language_sheet"),
    shell:
        "egosplat language-sheet"
        " --poses {input.poses:q}"
        " --splats {input.splats:q}"
        " --language {input.language:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule queries_sheet:
    """Draw the queries with the best and the worst answers."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        annotations=artifact("annotations"),
        splats=artifact("splats"),
        language=artifact("language"),
        metrics=artifact("metrics"),
        learnt=learnt_artifacts("queries_sheet"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}queries.png",
            caption="../report/queries.rst",
            category="Scenes",
            labels=labels("queries"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}queries_sheet.log",
    resources:
        mem_mb=memory("queries_sheet"),
        runtime=runtime("queries_sheet"),
    params:
        title=get_title,
        learnt=learnt_flags("queries_sheet"),
        code=code_of("queries_sheet"),
    shell:
        "egosplat queries-sheet"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --annotations {input.annotations:q}"
        " --splats {input.splats:q}"
        " --language {input.language:q}"
        " --metrics {input.metrics:q}"
        " {params.learnt}"
        " --title {params.title:q}"
        " --output {output:q}"
        " 2>&1 | tee {log:q}"


rule methods_sheet:
    """Draw the answers of the compared methods to the same queries side by side."""
    input:
        metrics=lambda wildcards: compared_methods(scene_of(wildcards)),
    output:
        report(
            "results/{dataset}/{scene}/methods.png",
            caption="../report/methods.rst",
            category="Scenes",
            labels=labels("methods"),
        ),
    log:
        "logs/{dataset}/{scene}/methods_sheet.log",
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        title=get_title,
        code=code_hash("egosplat.report.sheets.methods_sheet", libraries=("matplotlib", "torch")),
    shell:
        "egosplat methods-sheet"
        " --title {params.title:q}"
        " --output {output:q}"
        " {input.metrics:q}"
        " 2>&1 | tee {log:q}"


rule scene_page:
    """Write the scene as one HTML file that answers queries in the browser."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        instances=artifact("instances"),
        features=artifact("features"),
        splats=artifact("splats"),
        language=artifact("language"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}scene.html",
            caption="../report/scene_page.rst",
            category="Scenes",
            labels=labels("scene to walk through"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}scene_page.log",
    resources:
        mem_mb=4000,
        runtime=15,
    params:
        title=get_title,
        flags=flags("scene_page"),
        code=code_of("scene_page"),
    shell:
        "egosplat scene-page"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --instances {input.instances:q}"
        " --features {input.features:q}"
        " --splats {input.splats:q}"
        " --language {input.language:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule story:
    """Tell on one page what became of the scene, step by step."""
    input:
        get_story_files,
    output:
        report(
            "results/{dataset}/{scene}/{variant}story.html",
            caption="../report/story.rst",
            category="Overview",
            labels=labels("story"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}story.log",
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        title=get_title,
        code=code_hash("egosplat.report.story", libraries=("jinja2",)),
    shell:
        "egosplat story"
        " --title {params.title:q}"
        " --output {output:q}"
        " {input:q}"
        " 2>&1 | tee {log:q}"
