"""
Survey of a scene: whether what moves is masked, and which frames add views.

REQUIRED INPUTS: frames.zarr, poses.zarr. Never annotations.zarr.
OUTPUTS: survey.json, as src/egosplat/pipeline/schemas/survey.schema.yaml describes it.

A checkpoint: its result decides which rules follow; until it has run, a plan shows all that may follow. A rule that reads the
survey reruns only if a decision that it uses has changed; in the run that makes the survey, so do the rules after such a rule.
"""


checkpoint survey:
    """Decide from frames and poses whether what moves is masked, and which frames to train on."""
    input:
        frames=shared("frames.zarr"),
        poses=shared("poses.zarr"),
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
        **request("survey"),
    params:
        **params("survey"),
    shell:
        "egosplat survey {params.arguments} --output {output:q} --options {params.options:q} 2>&1 | tee {log:q}"
