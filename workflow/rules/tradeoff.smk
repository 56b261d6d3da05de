"""
Speed against accuracy of a scene: presets, and each knob alone.

REQUIRED INPUTS: metrics.json of the scene and of the variants that the configuration's section tradeoff names.
OUTPUTS: tradeoff/tradeoff.html, .csv, .json and .png.
TOOLS: SciPy, pandas, matplotlib, Jinja2.
"""


def tradeoff_code():
    """Content hash of the code that compares points."""
    return code_hash(
        "egosplat.tradeoff.stage",
        ("jinja2", "jsonschema", "matplotlib", "pandas", "scipy"),
    )


@cache
def measured_points(dataset, scene):
    """The points of a scene: their settings, and metrics.json of each of their runs."""
    found = find_scene(scenes, dataset, scene)
    return [
        {
            "settings": [[one.knob, one.value] for one in point.settings],
            "metrics": [
                f"{found.results}/{folder_of_variant(variant)}metrics.json"
                for variant in point.variants
            ],
        }
        for point in points_of(found.config, f"{dataset}/{scene}")
    ]


def metrics_of_points(wildcards):
    """All these files."""
    points = measured_points(wildcards.dataset, wildcards.scene)
    return [path for point in points for path in point["metrics"]]


def points_flag(wildcards):
    """The points as one command line argument."""
    return shlex.quote(json.dumps(measured_points(wildcards.dataset, wildcards.scene)))


rule tradeoff:
    """Compare what the points of a scene cost, and how accurate they are."""
    input:
        metrics=metrics_of_points,
        page=PACKAGE / "tradeoff/tradeoff.html.j2",
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
        points=points_flag,
        code=tradeoff_code(),
    shell:
        "egosplat tradeoff"
        " --output results/{wildcards.dataset}/{wildcards.scene}/tradeoff"
        " --points {params.points}"
        " 2>&1 | tee {log:q}"
