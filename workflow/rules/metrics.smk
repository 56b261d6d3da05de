"""
Scores of a scene: localization, masks and rendering.

REQUIRED INPUTS: frames.zarr, poses.zarr, annotations.zarr, features.zarr or tiles.zarr, splats.zarr, language.zarr. The stage also
reads the time and memory of the artifacts that these were made from.
OUTPUTS: metrics.json, as src/egosplat/pipeline/schemas/metrics.schema.yaml describes it; results/benchmark/ for all scenes.
"""


rule metrics:
    """Query every annotated category in the evaluation frames, and score answers and renders."""
    input:
        **configured("metrics"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
        annotations=shared("annotations.zarr"),
        splats=shared("splats.zarr"),
        language=shared("language.zarr"),
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
        **request("metrics"),
    params:
        **params("metrics"),
    shell:
        "egosplat metrics {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
