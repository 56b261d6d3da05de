"""
What a scene requires: does anything move, which frames add views.

REQUIRED INPUTS: frames.zarr, poses.zarr. Never annotations.zarr.
OUTPUTS: survey.json, as src/egosplat/pipeline/schemas/survey.schema.yaml describes it.
TOOLS: OpenCV.

A checkpoint: which rules follow depends on what it finds. Until it has run, a plan shows what may follow. Rules that
read it rerun where a decision that they use changed, not because it was made again; but Snakemake still makes again, in
the run that made the survey, what comes after such a rule that it then spared.
"""


checkpoint survey:
    """Decide by the pictures and their poses alone what the scene requires."""
    input:
        frames=artifact("frames"),
        poses=artifact("poses"),
    output:
        report(
            "results/{dataset}/{scene}/{variant}survey.json",
            caption="../report/survey.rst",
            category="Scenes",
            labels=labels("survey"),
        ),
    log:
        "logs/{dataset}/{scene}/{variant}survey.log",
    benchmark:
        "logs/{dataset}/{scene}/{variant}survey.tsv"
    resources:
        mem_mb=memory("survey"),
        runtime=runtime("survey"),
    params:
        flags=flags("survey"),
        code=code_of("survey"),
    shell:
        "egosplat survey"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
