"""
Figures of a scene, and the scene as one page that answers queries.

REQUIRED INPUTS: frames.zarr, annotations.zarr, poses.zarr, segments.zarr, view_features.zarr, features.zarr,
tiles.zarr, transient.zarr, masks.zarr, splats.zarr, language.zarr, histories.zarr, metrics.json.
OUTPUTS: contact_sheet.png, instances.png, crops.png, splats.png, transient.png, carries.png, queries.png, scene.html, story.html.
"""

# Stages that draw a sheet of a scene, with its label in Snakemake's report.
SHEETS = {
    "contact_sheet": "recording",
    "instances_sheet": "instances",
    "crops_sheet": "crops",
    "splats_sheet": "renders",
    "transient_sheet": "what moves",
    "carries_sheet": "what is carried",
    "queries_sheet": "queries",
}

for sheet, label in SHEETS.items():

    rule:
        """Draw a sheet of a scene; `egosplat --help` says which shows what."""
        name:
            sheet
        input:
            **{name: shared(STAGES[name].output) for name in STAGES[sheet].inputs},
            **configured(sheet),
        output:
            report(
                f"results/{{dataset}}/{{scene}}/{{variant}}{STAGES[sheet].output}",
                caption=f"../report/{Path(STAGES[sheet].output).stem}.rst",
                category="Scenes",
                labels=labels(label),
            ),
        log:
            f"logs/{{dataset}}/{{scene}}/{{variant}}{sheet}.log",
        resources:
            **request(sheet),
        params:
            **params(sheet),
            command=sheet.replace("_", "-"),
        shell:
            "egosplat {params.command} {params.arguments} --output {output:q} 2>&1 | tee {log:q}"


rule scene_page:
    """Write the scene as one HTML file that answers queries in the browser."""
    input:
        **configured("scene_page"),
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
        instances=shared("instances.zarr"),
        features=shared("features.zarr"),
        splats=shared("splats.zarr"),
        language=shared("language.zarr"),
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
        **request("scene_page"),
    params:
        **params("scene_page"),
    shell:
        "egosplat scene-page {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"


rule story:
    """Tell on one page what became of the scene, step by step."""
    input:
        asked(jobs.story_files),
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
        title=asked(jobs.scene_value, "title"),
        code=code_hash("egosplat.report.story", libraries=("jinja2",)),
    shell:
        "egosplat story --title {params.title:q} --output {output:q} {input:q} 2>&1 | tee {log:q}"
