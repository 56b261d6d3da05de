"""
Methods of others on the same data, the paper's tables, and speed against accuracy: egosplat_rivals.

REQUIRED INPUTS: frames.zarr, survey.json; metrics.json of scenes and their variants.
OUTPUTS: tiles.zarr, methods.png and tradeoff/ of a scene; results/benchmark/tables.html and tradeoff.html.
"""

from egosplat_rivals import compared

PAGES = ("jinja2", "jsonschema", "pandas")
CHARTS = ("adjustText", "jinja2", "jsonschema", "matplotlib", "pandas")
TABLES = ("adt_accuracy", "adt_iou", "adt_ablation", "hoi4d", "adt_transient")


localrules:
    tables,
    tradeoff,
    tradeoff_scenes,


rule tiles:
    """Encode the tiles of each training frame with OpenCLIP, for the methods of others that need them."""
    input:
        **configured("tiles"),
        frames=shared("frames.zarr"),
    output:
        directory("results/{dataset}/{scene}/{variant}tiles.zarr"),
    log:
        "logs/{dataset}/{scene}/{variant}tiles.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}tiles.tsv"
    threads: 8
    resources:
        **request("tiles"),
    params:
        **params("tiles"),
    shell:
        "egosplat tiles {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


use rule tiles as tiles_chunk with:
    output:
        temp("results/{dataset}/{scene}/{variant}tiles.{chunk}.chunk"),
    log:
        "logs/{dataset}/{scene}/{variant}tiles.{chunk}.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}tiles.{chunk}.tsv"


rule tables:
    """Write the scores of all scenes and variants as the paper's tables, next to its printed numbers."""
    input:
        metrics=lambda _: or_exit(compared.table_scores, scenes.values()),
        pictures=lambda _: or_exit(compared.table_pictures, scenes.values()),
    output:
        expand("results/benchmark/{name}.csv", name=TABLES),
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
        pictures=lambda wildcards, input: [
            word for path in input.pictures for word in ("--picture", path)
        ],
        code=code_hash("egosplat_rivals.tables.stage", libraries=PAGES),
    shell:
        "egosplat-rivals tables --output results/benchmark {params.pictures:q} {input.metrics:q} 2>&1 | tee {log:q}"


rule tradeoff:
    """Compare cost and accuracy of a scene and its variants in tradeoff.variants."""
    input:
        metrics=asked(lambda job: compared.compared_variants(job.scene)),
    output:
        multiext("results/{dataset}/{scene}/tradeoff/tradeoff", ".csv", ".png"),
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
        folder=subpath(output.page, parent=True),
        code=code_hash("egosplat_rivals.tradeoff.stage", libraries=CHARTS),
    shell:
        "egosplat-rivals tradeoff --output {params.folder:q} {input.metrics:q} 2>&1 | tee {log:q}"


use rule tradeoff as tradeoff_scenes with:
    input:
        metrics=lambda _: or_exit(
            lambda: [
                path
                for name in settings["tradeoff"]["scenes"]
                for path in compared.compared_variants(
                    job_named(*name.split("/")).scene
                )
            ]
        ),
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


rule methods_sheet:
    """Draw the answers of the compared methods to the same queries side by side."""
    input:
        metrics=asked(lambda job: compared.compared_methods(job.scene)),
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
        mem_mb=6500,
        runtime=30,
    params:
        title=asked(jobs.scene_value, "title"),
        code=code_hash(
            "egosplat_rivals.methods_sheet", libraries=("matplotlib", "torch")
        ),
    shell:
        "egosplat-rivals methods-sheet --title {params.title:q} --output {output:q} {input.metrics:q} 2>&1 | tee {log:q}"
