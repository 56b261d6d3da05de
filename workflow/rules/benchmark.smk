"""
How well a scene is found, outlined and rendered.

REQUIRED INPUTS: frames.zarr, poses.zarr, annotations.zarr, features.zarr, splats.zarr, language.zarr; what these were
made from is looked at beside them, for its time and memory.
OUTPUTS: metrics.json, as src/egosplat/pipeline/schemas/metrics.schema.yaml describes it; of all scenes results/benchmark/.
TOOLS: OpenCLIP, PyTorch, egosplat's kernels or gsplat; Jinja2.
"""

import egosplat
from egosplat.pipeline.code_hash import code_hash

PACKAGE = Path(egosplat.__file__).parent

TABLES = ("adt_accuracy", "adt_iou", "adt_ablation", "hoi4d", "adt_transient")
ABLATIONS = ("baseline", "aggregation", "initial")
"""The variants that the tables have rows for, beside the scene itself."""


def tables_code():
    """Content hash of the code that lays out tables."""
    return code_hash("egosplat.tables.stage", ("jinja2", "jsonschema", "pandas"))


def scores_of_scenes(_):
    """metrics.json of every scene that is there or can be made, and of its ablations; of scenes that are made by name
    alone, those that were."""
    own = [path for scene in available() for path in scores_of(scene)]
    by_name = [
        path
        for scene in scenes.values()
        if scene.by_name
        for path in scores_of(scene)
        if path.exists()
    ]
    return [str(path) for path in (*own, *by_name)]


def scores_of(scene):
    """metrics.json of a scene and of its ablations."""
    folders = ("", *(f"variants/{name}" for name in ABLATIONS))
    return [scene.results / folder / "metrics.json" for folder in folders]


def pictures_of_scenes(_):
    """The pictures on the page."""
    return [
        str(scene.results / name)
        for scene in available()
        for name in ("splats.png", "language.png")
    ]


def picture_flags(wildcards):
    """The same as command line flags."""
    return " ".join(
        f"--picture {shlex.quote(path)}" for path in pictures_of_scenes(wildcards)
    )


rule metrics:
    """Ask for everything that is annotated in the evaluation frames, and score answers and renders."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
        annotations=artifact("annotations"),
        features=artifact("features"),
        splats=artifact("splats"),
        language=artifact("language"),
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
        title=title,
        flags=flags("metrics"),
        models=models("metrics"),
        code=code_of("metrics"),
    shell:
        "egosplat metrics"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --annotations {input.annotations:q}"
        " --features {input.features:q}"
        " --splats {input.splats:q}"
        " --language {input.language:q}"
        " --title {params.title:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule tables:
    """Lay the scores of all scenes and variants out as the paper's tables, its printed numbers beside."""
    input:
        metrics=scores_of_scenes,
        pictures=pictures_of_scenes,
        printed=PACKAGE / "benchmark/paper_numbers.csv",
        page=PACKAGE / "benchmark/tables.html.j2",
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
        pictures=picture_flags,
        code=tables_code(),
    shell:
        "egosplat tables"
        " --output results/benchmark"
        " {params.pictures}"
        " {input.metrics:q}"
        " 2>&1 | tee {log:q}"
