"""The page ``docs/scale.md``: what was measured, what follows, and how far that reaches."""

from collections.abc import Mapping
from dataclasses import fields

from egosplat.cluster.memory import peak_mb
from growth_bench import tables
from growth_bench.assumptions import Assumptions
from growth_bench.design import POINTS
from growth_bench.extrapolation import (
    Cluster,
    Cost,
    costs_of,
    on_cluster,
    paper_config,
    paper_sizes,
    stages_of,
    with_paper_models,
)
from growth_bench.laws import CPU, DISK, MEMORY, fit_all
from growth_bench.readings import Run, Sizes
from growth_bench.store import Measured


class GivenShapes:
    """Sizes that are known, in place of those that a job's inputs tell (``egosplat.cluster.shapes.Shapes``)."""

    def __init__(self, sizes: Sizes) -> None:
        self.__dict__.update(sizes)


def page(measured: Measured, assumed: Assumptions) -> str:
    """Markdown."""
    fits = fit_all(measured.runs)
    sizes, config = paper_sizes(assumed), paper_config()
    paper_fits = with_paper_models(fits, measured.published, assumed)
    costs = costs_of(paper_fits, stages_of(config), sizes, assumed)
    shapes = GivenShapes(sizes)
    expected = {stage: peak_mb(stage, config, shapes) for stage in costs}
    checks = {name: joint_sizes(runs) for name, runs in measured.checks.items()}
    parts = [
        _beginning(measured),
        "## Growth",
        LAWS_TEXT,
        *_laws(fits),
        *_checks(fits, measured.checks),
        "## One ADT sequence at the paper's settings",
        _sequence_text(measured, costs, assumed),
        tables.sequence(costs, expected),
        f"## All {assumed.sequences} sequences on {assumed.gpus} GPUs",
        _cluster_text(on_cluster(costs, assumed), assumed),
        "## How far this reaches",
        REACH_TEXT,
        tables.reach(measured.runs, checks, sizes),
        "## What is assumed",
        _assumed(assumed),
    ]
    return "\n\n".join(parts) + "\n"


LAWS_TEXT = (
    "Each law is a sum of terms over which the stage's code loops, no coefficient below 0, fitted by least squares of "
    "relative errors; of training pictures, three bytes a pixel are held at least. *k* is a thousand. *kept* are frames "
    "that the survey does not leave out, *training* those of them that learn, *evaluated* those that are asked about; "
    "*prompts* points that SAM2 was asked at; *followed* instances before those are left out that are seen too briefly, or "
    "are one with another; *autoencoder* is 1 where codes are an autoencoder's, else 0; *codes* numbers of a code at all "
    "levels together, *joint* the same where Gaussians learned them with their geometry, else 0; *initial* and "
    "*network* are the stage `transient`'s temporary Gaussians and its network. **Left out** are errors of laws that were "
    "fitted without the point that they predict: of a point that alone has a size, that is an extrapolation."
)

REACH_TEXT = (
    "Of each size what was measured, in the stages whose laws have it, and what the extrapolations go to. A law that was "
    "measured to one size says at fifty times of it what its terms say, and nothing of what begins only there: caches "
    "that no longer hold a picture, disks that are full, opacity that changes how many Gaussians a pixel shows."
)


def joint_sizes(runs: list[Run]) -> Sizes:
    """Those of a scene, as its runs all have them."""
    return {name: value for run in runs for name, value in run.sizes.items()}


def _beginning(measured: Measured) -> str:
    seconds = sum(run.cpu_s for run in measured.runs)
    return (
        "# How the pipeline grows\n\n"
        "Made by `python benchmarks/growth.py report benchmarks/growth.json`, which takes every number below from that "
        "file. The pipeline was run on small synthetic apartments with the small models, one factor changed at a "
        f"time and once all of them: {len(measured.points)} points of {len(POINTS)}, {len(measured.runs)} runs of stages, "
        f"{seconds:.0f} CPU-seconds of stages' work, one thread of {measured.machine.partition(', ')[0]}, with other work on "
        "the machine. CPU time and peak memory are what each artifact's provenance says, without the start of Python and its libraries (some "
        "seconds a stage). No GPU was there to be measured."
    )


def _laws(fits: tables.Fits) -> list[str]:
    titles = {CPU: "Processor time", MEMORY: "Peak memory", DISK: "Disk"}
    return [f"### {title}\n\n{tables.laws(fits, measure)}" for measure, title in titles.items()]


def _checks(fits: tables.Fits, checks: dict[str, list[Run]]) -> list[str]:
    if not checks:
        return []
    text = (
        "A finished scene that no law was fitted to, on two threads: what the laws say of its sizes, "
        "beside what its artifacts say they took. Together they come closer than each by itself, because errors cancel. No "
        "coefficient was fitted to it, but it is no blind test: some terms of `survey`, `segments`, `view_features` "
        "and `features`, and the point where all factors are large, were added after laws had been held against it."
    )
    parts = [f"### {name}\n\n{tables.held_against(fits, runs)}" for name, runs in checks.items()]
    return ["## Held against a larger scene", text, *parts]


def _sequence_text(measured: Measured, costs: Mapping[str, Cost], assumed: Assumptions) -> str:
    units = measured.published
    share = costs["segments"].cpu_s.value / sum(cost.cpu_s.value for cost in costs.values())
    return (
        f"{assumed.frames:,} frames of 1408 × 1408, `preset: paper`: the laws above, with the paper's models in place of "
        f"the small ones. These were measured apart, with random weights, on one thread: SAM2.1 hiera_b+ takes "
        f"{units['picture']:.2f} CPU-s for a picture, {units['prompt']:.3f} for a prompt and {units['followed']:.2f} for an "
        f"instance that is followed into a frame, its memory full; ViT-B-16 {units['crop']:.2f} for a crop. The preset asks "
        "for no survey.\n\n"
        "**CPU-hours** are measured and extrapolated, on one core; *least to most* is what laws say which lack one of "
        f"the points. {share:.0%} of them are `segments`, nearly all of it SAM2's attention to what it remembers of each "
        "instance: they grow with `--instances` and `--frames`, and a stride of frames divides them. **GPU-hours** are "
        "CPU-hours divided by an *assumed* factor, and no measurement. **Memory** is main memory of a run without a GPU; "
        "of a GPU's own nothing is known here. Where its least and most lie far apart, what grows was too little to be "
        "told beside what PyTorch takes, and the scheduler's law (`egosplat.cluster.memory`, before its margin, with "
        f"the preset's budget of {paper_config()['splats']['max_gaussians']:,} Gaussians; of `poses` COLMAP's) is the better "
        "guide. So it is for `view_features`, whose memory flattens from a few hundred views on, as the larger scene "
        "shows. Nothing was masked in what was measured: in `splats`, masks add a byte a pixel and training frame."
    )


def _cluster_text(cluster: Cluster, assumed: Assumptions) -> str:
    return (
        f"- **{tables.hours(cluster.cpu_s)} CPU-hours** without any GPU, as extrapolated.\n"
        f"- **{tables.hours(cluster.gpu_s)} GPU-hours**, as assumed.\n"
        f"- **{tables.hours(cluster.wall_s)} hours** on the clock: each GPU works off at most {cluster.rounds} sequences, one "
        "after the other, with one core beside it for the stages that use no GPU, and nothing waits for file systems "
        "or schedulers.\n"
        f"- **{tables.number(cluster.disk_mb / 1024**2)} TiB** of artifacts, beside the recordings."
    )


def _assumed(assumed: Assumptions) -> str:
    rows = [
        [
            f"`--{one.name.replace('_', '-')}`",
            one.metadata["about"],
            f"{getattr(assumed, one.name):,}",
        ]
        for one in fields(Assumptions)
    ]
    return (
        "None of these was measured. Each is an option of `report`, which takes a second: "
        "`python benchmarks/growth.py report benchmarks/growth.json --network-speedup 400`. The two factors' defaults are guesses "
        "from peaks: the paper's card, an RTX 3090, has 35,600 GFLOP/s by its data sheet, a core 117 "
        "([measured](../benchmarks/rasterizer.md)), 300 times less; of that, two thirds for networks, a sixth for rendering.\n\n"
        + tables.table(("option", "what", "assumed here"), rows, words=2)
    )
