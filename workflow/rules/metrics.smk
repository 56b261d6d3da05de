"""
Scores of a scene: localization, masks and rendering.

REQUIRED INPUTS: frames.zarr, poses.zarr, annotations.zarr, features.zarr or tiles.zarr, splats.zarr, language.zarr. The stage also
reads the time and memory of the artifacts that these were made from. For methods that were run elsewhere, their maps.
OUTPUTS: metrics.json, as src/egosplat/pipeline/schemas/metrics.schema.yaml describes it; results/benchmark/ for all scenes.
TOOLS: OpenCLIP, PyTorch, egosplat's kernels or gsplat; Jinja2.
"""

TABLES = ("adt_accuracy", "adt_iou", "adt_ablation", "hoi4d", "adt_transient")


rule metrics:
    """Query every annotated category in the evaluation frames, and score answers and renders."""
    input:
        **inputs("metrics"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}metrics.json",
            caption="../report/metrics.rst",
            category="Scenes",
            labels=labels("scores"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}metrics.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}metrics.tsv"
    threads: 8
    resources:
        mem_mb=memory("metrics"),
        runtime=runtime("metrics"),
        gpu=gpus("metrics"),
    params:
        **params("metrics"),
    shell:
        "egosplat metrics {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule method_metrics:
    """Score the relevancy maps of a method that was run elsewhere; tables.maps is their folder."""
    input:
        **inputs("method_metrics"),
    output:
        report(
            "results/{dataset}/{scene}/methods/{method}/metrics.json",
            caption="../report/metrics.rst",
            category="Scenes",
            labels=labels("scores"),
        ),
    log:
        "logs/{dataset}/{scene}/methods/{method}/metrics.log",
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        **params("method_metrics"),
    shell:
        "egosplat method-metrics {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


localrules:
    tables,


rule tables:
    """Write the scores of all scenes and variants as the paper's tables, next to its printed numbers."""
    input:
        metrics=lambda _: table_scores(scenes.values()),
        pictures=lambda _: table_pictures(scenes.values()),
    output:
        expand(
            "results/benchmark/{name}.{form}", name=TABLES, form=("csv", "md", "tex")
        ),
        page=report(
            "results/benchmark/tables.html",
            caption="../report/tables.rst",
            category="Tables",
            labels={"page": "tables"},
        ),
    log:
        "logs/benchmark/tables.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        pictures=get_picture_flags,
        code=code_hash(
            "egosplat.report.tables.stage",
            libraries=("jinja2", "jsonschema", "pandas"),
        ),
    shell:
        "egosplat tables"
        " --output results/benchmark"
        " {params.pictures}"
        " {input.metrics:q}"
        " 2>&1 | tee {log:q}"
