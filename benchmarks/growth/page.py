"""The page docs/scale.md: the laws, the extrapolation, and its limits."""

from collections.abc import Mapping
from dataclasses import fields

from benchmarks.growth import tables
from benchmarks.growth.assumptions import Assumptions
from benchmarks.growth.design import POINTS
from benchmarks.growth.extrapolation import (
    Cluster,
    Cost,
    costs_of,
    on_cluster,
    paper_config,
    paper_sizes,
    stages_of,
)
from benchmarks.growth.laws import fit_all
from benchmarks.growth.readings import Run, Sizes
from benchmarks.growth.store import Measured
from benchmarks.growth.unfitted import with_paper_models
from egosplat.cost_model.laws import CPU, DISK, MEMORY


def page(measured: Measured, assumed: Assumptions) -> str:
    """Markdown."""
    fits = fit_all(measured.runs)
    sizes = paper_sizes(assumed)
    paper_fits = with_paper_models(fits, measured.published, assumed)
    costs = costs_of(paper_fits, stages_of(paper_config()), sizes, assumed)
    checks = {name: joint_sizes(runs) for name, runs in measured.checks.items()}
    parts = [
        _beginning(measured),
        "## Growth",
        LAWS_TEXT,
        *_laws(fits),
        *_checks(fits, measured.checks),
        "## One ADT sequence at the paper's settings",
        _sequence_text(measured, costs, assumed),
        tables.sequence(costs),
        f"## All {assumed.sequences} sequences on {assumed.gpus} GPUs",
        _cluster_text(on_cluster(costs, assumed)),
        "## Limits",
        REACH_TEXT,
        tables.reach(measured.runs, checks, sizes),
        "## Assumptions",
        _assumed(assumed),
    ]
    return "\n\n".join(parts) + "\n"


LAWS_TEXT = (
    "A law is a sum of terms; each term stands for a loop in the stage's code. Coefficients are at least 0 and fitted "
    "by least squares of relative errors. Three coefficients of memory follow from the code and are not fitted: three "
    "bytes for each pixel of a training frame (`transient`, `splats`), and four float32 copies of each view's feature "
    "(`view_features`). *k* is a thousand.\n\n"
    "| size | meaning |\n| --- | --- |\n"
    "| kept, training | frames that the survey keeps; kept frames that are training frames |\n"
    "| evaluated | frames that the benchmark scores |\n"
    "| prompts | point prompts of SAM2 |\n"
    "| tracked | instances that SAM2 tracks, before short and duplicate ones are removed |\n"
    "| sam2 area | area of SAM2's input, relative to the model's own |\n"
    "| autoencoder | 1 if the autoencoder compresses the features, else 0 |\n"
    "| codes | numbers in a code, all levels together |\n"
    "| joint | numbers in a code if codes are trained jointly with the geometry, else 0 |\n"
    "| initial, network | the temporary Gaussians and the network of the stage `transient` |\n\n"
    "**Held out** errors are those of laws that are fitted without the point that they predict. If no other point has "
    "such a size, this is an extrapolation."
)

REACH_TEXT = (
    "The table compares the measured range of each size, over the stages whose laws contain it, with the sizes that the "
    "laws are extrapolated to. The laws do not contain effects that begin only at larger sizes, such as frames that no "
    "longer fit into the caches, full disks, or a change of opacity that changes the number of Gaussians per pixel."
)


def joint_sizes(runs: list[Run]) -> Sizes:
    """The sizes of a scene, joined over its runs."""
    return {name: value for run in runs for name, value in run.sizes.items()}


def _beginning(measured: Measured) -> str:
    seconds = sum(run.cpu_s for run in measured.runs)
    return (
        "# How the pipeline grows\n\n"
        "`python -m benchmarks.growth report benchmarks/growth/growth.json` writes this page. The same laws are in "
        "[coefficients.json](../src/egosplat/cost_model/coefficients.json), which "
        "`python -m benchmarks.growth coefficients benchmarks/growth/growth.json` writes, and which the cluster profile and "
        "`egosplat doctor` read.\n\n"
        "The pipeline ran on small synthetic apartments with the small models. Each point changes one factor, and one point "
        f"changes all: {len(measured.points)} of {len(POINTS)} points, {len(measured.runs)} runs of stages, "
        f"{seconds:.0f} CPU-seconds, one thread of {measured.machine.partition(', ')[0]}, with other work on the machine. CPU time "
        "and peak memory come from each artifact's provenance. They do not include the start of Python and its libraries "
        "(some seconds per stage). No GPU was measured."
    )


def _laws(fits: tables.Fits) -> list[str]:
    titles = {CPU: "Processor time", MEMORY: "Peak memory", DISK: "Disk"}
    return [f"### {title}\n\n{tables.laws(fits, measure)}" for measure, title in titles.items()]


def _checks(fits: tables.Fits, checks: dict[str, list[Run]]) -> list[str]:
    if not checks:
        return []
    text = (
        "The tables compare predictions with measurements of a finished scene that no law was fitted to, on two threads. The "
        "sums are closer than single stages because errors cancel. This is not a blind test: some terms of `survey`, "
        "`segments`, `view_features` and `features`, and the point with all factors large, were added after a comparison with it."
    )
    parts = [f"### {name}\n\n{tables.held_against(fits, runs)}" for name, runs in checks.items()]
    return ["## Checked on a larger scene", text, *parts]


def _sequence_text(measured: Measured, costs: Mapping[str, Cost], assumed: Assumptions) -> str:
    units = measured.published
    share = costs["segments"].cpu_s.value / sum(cost.cpu_s.value for cost in costs.values())
    return (
        f"The laws above, applied to {assumed.frames:,} frames of 1408 × 1408 and `preset: paper`, with the paper's models instead of "
        "the small ones. The unit costs of these models were measured separately, with random weights, on one thread. SAM2.1 hiera_b+ takes "
        f"{units['picture']:.2f} CPU-s for a frame, {units['prompt']:.3f} for a prompt and {units['tracked']:.2f} for a "
        f"tracked instance in a frame, with its memory full; ViT-B-16 takes {units['crop']:.2f} for a crop. The preset needs "
        "no survey.\n\n"
        "**CPU-hours** are extrapolated from measurements on one core. *Lowest to highest* is the range of laws that are "
        f"fitted with one point left out. `segments` takes {share:.0%} of the CPU-hours, nearly all for SAM2's attention to the memory "
        "of each instance. They are proportional to `--instances` and `--frames`, so a stride of frames divides them. **GPU-hours** "
        "are CPU-hours divided by an *assumed* factor; they are not measured. **Memory** is main memory of a run without a GPU; "
        "memory of a GPU is not known. These runs had no masks; masks add one byte per pixel and training frame to `splats`.\n\n"
        "A job requests this memory and a margin ([cluster.md](cluster.md#what-jobs-request)), for the largest numbers of "
        "instances and Gaussians that the configuration allows."
    )


def _cluster_text(cluster: Cluster) -> str:
    return (
        f"- **{tables.hours(cluster.cpu_s)} CPU-hours** without any GPU, extrapolated.\n"
        f"- **{tables.hours(cluster.gpu_s)} GPU-hours**, assumed.\n"
        f"- **{tables.hours(cluster.wall_s)} hours** on the clock: each GPU processes at most {cluster.rounds} sequences, one "
        "after the other, with one core for the stages that use no GPU, and without waiting for file systems or schedulers.\n"
        f"- **{tables.number(cluster.disk_mb / 1024**2)} TiB** of artifacts, without the recordings."
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
        "None of these values is measured. Each is an option of `report`: "
        "`python -m benchmarks.growth report benchmarks/growth/growth.json --network-speedup 400`. The defaults of the two speed-ups follow from "
        "peak rates. An RTX 3090, the paper's card, has 35,600 GFLOP/s by its data sheet. One core has 117 "
        "([measured](../benchmarks/rasterizer/README.md)), 300 times less. Networks are assumed to reach two thirds of that ratio, "
        "rendering one sixth.\n\n" + tables.table(("option", "meaning", "assumed value"), rows, words=2)
    )
