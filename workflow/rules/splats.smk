"""
The scene as 3D Gaussians.

REQUIRED INPUTS: frames.zarr, poses.zarr; as configured, masks.zarr or transient.zarr, and segments.zarr and
features.zarr. Never annotations.zarr.
OUTPUTS: splats.zarr, language.zarr; beside each, while it is made, .{name}.checkpoint, from which a killed run goes on.
TOOLS: PyTorch, egosplat's kernels or gsplat, torchmetrics.
"""

MASKS = {"none": [], "initial": ["transient"], "refined": ["masks"]}
"""By splats.masking: the artifacts that say what moves."""


def masks_of(wildcards):
    """The artifacts that say what moves, as the scene's configuration asks for it."""
    return MASKS[scene_of(wildcards).config["splats"]["masking"]]


def codes_of(wildcards):
    """The artifacts from which codes are trained with the geometry, where they are."""
    joint = scene_of(wildcards).config["splats"]["language"] == "joint"
    return ["segments", "features"] if joint else []


def artifacts(*functions):
    """A function of the wildcards: paths of the artifacts that the functions name."""

    def paths(wildcards):
        names = [name for function in functions for name in function(wildcards)]
        return [
            f"results/{wildcards.dataset}/{wildcards.scene}/{name}.zarr"
            for name in names
        ]

    return paths


def path_flags(*functions):
    """A function of the wildcards: the same as command line flags."""

    def flags_of_scene(wildcards):
        names = [name for function in functions for name in function(wildcards)]
        folder = f"results/{wildcards.dataset}/{wildcards.scene}"
        return " ".join(
            f"--{name} {shlex.quote(f'{folder}/{name}.zarr')}" for name in names
        )

    return flags_of_scene


rule splats:
    """Train Gaussians on the training frames, and measure how well they render the held-out ones."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        poses="results/{dataset}/{scene}/poses.zarr",
        others=artifacts(masks_of, codes_of),
    output:
        directory("results/{dataset}/{scene}/splats.zarr"),
    log:
        "logs/{dataset}/{scene}/splats.log",
    benchmark:
        "logs/{dataset}/{scene}/splats.tsv"
    threads: 8
    resources:
        mem_mb=16000,
        runtime="24h",
    params:
        others=path_flags(masks_of, codes_of),
        flags=flags("splats"),
        code=code_of("splats"),
    shell:
        "egosplat splats"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"


rule language:
    """Give each Gaussian the codes of what it shows, at every level."""
    input:
        frames="results/{dataset}/{scene}/frames.zarr",
        poses="results/{dataset}/{scene}/poses.zarr",
        segments="results/{dataset}/{scene}/segments.zarr",
        features="results/{dataset}/{scene}/features.zarr",
        splats="results/{dataset}/{scene}/splats.zarr",
        others=artifacts(masks_of),
    output:
        directory("results/{dataset}/{scene}/language.zarr"),
    log:
        "logs/{dataset}/{scene}/language.log",
    benchmark:
        "logs/{dataset}/{scene}/language.tsv"
    threads: 8
    resources:
        mem_mb=16000,
        runtime="12h",
    params:
        others=path_flags(masks_of),
        flags=flags("language"),
        code=code_of("language"),
    shell:
        "egosplat language"
        " --frames {input.frames:q}"
        " --poses {input.poses:q}"
        " --segments {input.segments:q}"
        " --features {input.features:q}"
        " --splats {input.splats:q}"
        " {params.others}"
        " --output {output:q}"
        " {params.flags}"
        " 2>&1 | tee {log:q}"
