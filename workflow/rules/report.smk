"""
Figures of a scene, and the scene as one page that answers queries.

REQUIRED INPUTS: frames.zarr, annotations.zarr, poses.zarr, segments.zarr, view_features.zarr, features.zarr,
tiles.zarr, transient.zarr, masks.zarr, splats.zarr, language.zarr, metrics.json.
OUTPUTS: contact_sheet.png, instances.png, crops.png, splats.png, transient.png, language.png, queries.png, methods.png,
scene.html, story.html.
TOOLS: matplotlib; egosplat's kernels or gsplat; OpenCLIP; Jinja.
"""


rule contact_sheet:
    """Draw a scene's frames and annotations, and its trajectory and points from above."""
    input:
        **inputs("contact_sheet"),
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
        **params("contact_sheet"),
    shell:
        "egosplat contact-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule instances_sheet:
    """Draw the instances of each level in frames and from above, and crops before and after merging."""
    input:
        **inputs("instances_sheet"),
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
        **params("instances_sheet"),
    shell:
        "egosplat instances-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule crops_sheet:
    """Draw crops of instances in order of time, with outlier views crossed out."""
    input:
        **inputs("crops_sheet"),
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
        **params("crops_sheet"),
    shell:
        "egosplat crops-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule splats_sheet:
    """Draw held-out frames next to their renders, and the training curves."""
    input:
        **inputs("splats_sheet"),
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
        **params("splats_sheet"),
    shell:
        "egosplat splats-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule transient_sheet:
    """Draw transient probability, masks, and the renders without the masked objects."""
    input:
        **inputs("transient_sheet"),
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
        **params("transient_sheet"),
    shell:
        "egosplat transient-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule language_sheet:
    """Draw the Gaussians' codes from several directions, at each level."""
    input:
        **inputs("language_sheet"),
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
        **params("language_sheet"),
    shell:
        "egosplat language-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule queries_sheet:
    """Draw the queries with the best and the worst answers."""
    input:
        **inputs("queries_sheet"),
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
        **params("queries_sheet"),
    shell:
        "egosplat queries-sheet {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


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
        code=code_hash(
            "egosplat.report.sheets.methods_sheet", libraries=("matplotlib", "torch")
        ),
    shell:
        "egosplat methods-sheet"
        " --title {params.title:q}"
        " --output {output:q}"
        " {input.metrics:q}"
        " 2>&1 | tee {log:q}"


rule scene_page:
    """Write the scene as one HTML file that answers queries in the browser."""
    input:
        **inputs("scene_page"),
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
        **params("scene_page"),
    shell:
        "egosplat scene-page {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


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
