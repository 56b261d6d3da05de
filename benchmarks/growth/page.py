"""The page docs/scale.md: the laws, the extrapolation, and its limits."""

from dataclasses import fields
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from benchmarks.common import markdown
from benchmarks.growth import tables
from benchmarks.growth.assumptions import Assumptions
from benchmarks.growth.design import POINTS
from benchmarks.growth.extrapolation import costs_of, on_cluster, paper_config, paper_sizes, stages_of
from benchmarks.growth.laws import fit_all
from benchmarks.growth.readings import Run, Sizes
from benchmarks.growth.store import Measured
from benchmarks.growth.unfitted import with_paper_models
from egosplat.cost_model.laws import CPU, DISK, MEMORY

TEMPLATE = Path(__file__).with_name("scale.md.j2")


def page(measured: Measured, assumed: Assumptions) -> str:
    """The page in Markdown; its text is in ``scale.md.j2``."""
    fits = fit_all(measured.runs)
    sizes = paper_sizes(assumed)
    costs = costs_of(
        with_paper_models(fits, measured.published, assumed), stages_of(paper_config()), sizes, assumed
    )
    small = [run for runs in measured.points.values() for run in runs]
    checked = {name: joint_sizes(runs) for name, runs in measured.checks.items()}
    words = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    return words.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        measured=measured,
        points=len(POINTS),
        runs=len(small),
        seconds=sum(run.cpu_s for run in small),
        laws={measure: tables.laws(fits, measure) for measure in (CPU, MEMORY, DISK)},
        checks={name: tables.held_against(fits, runs) for name, runs in measured.checks.items()},
        furthest={name: tables.furthest(fits, runs) for name, runs in measured.checks.items()},
        assumed=assumed,
        units=measured.published,
        share=costs["segments"].cpu_s.value / sum(cost.cpu_s.value for cost in costs.values()),
        sequence=tables.sequence(costs),
        cluster=on_cluster(costs, assumed),
        hours=tables.hours,
        number=tables.number,
        reach=tables.reach(measured.runs, checked, sizes),
        assumptions=_assumptions(assumed),
    )


def joint_sizes(runs: list[Run]) -> Sizes:
    """The sizes of a scene, joined over its runs."""
    return {name: value for run in runs for name, value in run.sizes.items()}


def _assumptions(assumed: Assumptions) -> str:
    rows = [
        [f"`--{one.name.replace('_', '-')}`", one.metadata["about"], f"{getattr(assumed, one.name):,}"]
        for one in fields(Assumptions)
    ]
    return markdown(("option", "meaning", "assumed value"), rows, words=2)
