"""
Speed against accuracy of a scene, and of several: presets and single-parameter changes.

REQUIRED INPUTS: metrics.json of the scene and of the variants that the configuration's section tradeoff names.
OUTPUTS: tradeoff/tradeoff.html, .csv, .json and .png of a scene; results/benchmark/tradeoff.html, .csv and .png of the
scenes that tradeoff.scenes names.
TOOLS: SciPy, pandas, matplotlib, adjustText, Jinja2.
"""

TRADEOFF_LIBRARIES = (
    "adjustText",
    "jinja2",
    "jsonschema",
    "matplotlib",
    "pandas",
    "scipy",
)


localrules:
    tradeoff,
    tradeoff_scenes,


rule tradeoff:
    """Compare cost and accuracy of the points of a scene."""
    input:
        metrics=get_points_metrics,
    output:
        multiext("results/{dataset}/{scene}/tradeoff/tradeoff", ".csv", ".json", ".png"),
        page=report(
            "results/{dataset}/{scene}/tradeoff/tradeoff.html",
            caption="../report/tradeoff.rst",
            category="Speed against accuracy",
            labels=labels("trade-off"),
        ),
    log:
        "logs/{dataset}/{scene}/tradeoff.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        points=get_points_flag,
        code=code_hash("egosplat.report.tradeoff.stage", libraries=TRADEOFF_LIBRARIES),
    shell:
        "egosplat tradeoff"
        " --output results/{wildcards.dataset}/{wildcards.scene}/tradeoff"
        " --points {params.points}"
        " 2>&1 | tee {log:q}"


rule tradeoff_scenes:
    """Compare cost and accuracy of the points over several scenes."""
    input:
        documents=get_scenes_of_tradeoff,
    output:
        multiext("results/benchmark/tradeoff", ".csv", ".png"),
        page=report(
            "results/benchmark/tradeoff.html",
            caption="../report/tradeoff.rst",
            category="Speed against accuracy",
            labels={"page": "trade-off of several scenes"},
        ),
    log:
        "logs/benchmark/tradeoff.log",
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=code_hash("egosplat.report.tradeoff.stage", libraries=TRADEOFF_LIBRARIES),
    shell:
        "egosplat tradeoff-scenes"
        " {input.documents:q}"
        " --output results/benchmark"
        " 2>&1 | tee {log:q}"
