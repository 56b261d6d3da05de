"""The tables of docs/scale.md, in Markdown."""

from collections.abc import Callable, Mapping, Sequence

from benchmarks.common import markdown
from benchmarks.growth.extrapolation import ON_GPU, Cost
from benchmarks.growth.fitting import Fit, median_and_worst
from benchmarks.growth.laws import LAWS
from benchmarks.growth.readings import Run, Sizes
from egosplat.cost_model.laws import CPU, DISK, MEMORY, Term

Fits = Mapping[str, Mapping[str, Fit]]

UNITS = {CPU: "s", MEMORY: "MiB", DISK: "MiB"}

# Stages of a finished scene that take longer are compared in words [CPU-s].
LONG_S = 5.0

# Sizes whose coefficients are printed per thousand.
_THOUSANDS = ("pixels", "gaussians", "points")


def laws(fits: Fits, measure: str) -> str:
    """The law of each stage for one measure, and its errors."""
    columns = (
        "stage",
        f"law [{UNITS[measure]}]",
        "points",
        "median error",
        "worst",
        "held out: median",
        "held out: worst",
    )
    return markdown(columns, [_law_row(stage, own[measure]) for stage, own in fits.items()], words=2)


def _law_row(stage: str, law: Fit) -> list[str]:
    errors = (*median_and_worst(law.errors), *median_and_worst(law.left_out))
    return [stage, in_words(law.coefficients), str(len(law.errors)), *map(percent, errors)]


def in_words(coefficients: Mapping[Term, float]) -> str:
    """A law as a formula, without terms whose coefficient is 0."""
    parts = [_term(term, factor) for term, factor in coefficients.items() if factor > 0]
    return " + ".join(parts) or "0"


def _term(term: Term, factor: float) -> str:
    for name in term:
        factor *= 1000.0 if is_in_thousands(name) else 1.0
    return " · ".join([f"{factor:.3g}", *map(named, term)])


def is_in_thousands(name: str) -> bool:
    """Whether coefficients of this size are printed per thousand."""
    return name.endswith(_THOUSANDS)


def named(name: str) -> str:
    """The name of a size in a formula."""
    return ("k " if is_in_thousands(name) else "") + name.replace("_", " ")


def held_against(fits: Fits, runs: Sequence[Run]) -> str:
    """Predictions and measurements for a scene that no law was fitted to."""
    measures = {CPU: "CPU [s]", MEMORY: "memory [MiB]", DISK: "disk [MiB]"}
    columns = ["stage"]
    for title in measures.values():
        columns += [f"{title}: law", "measured", "ratio"]
    rows, sums = [], dict.fromkeys(measures, (0.0, 0.0))
    for run in sorted(runs, key=lambda one: list(LAWS).index(one.stage)):
        row = [run.stage]
        for measure in measures:
            law, found = fits[run.stage][measure].at(run.sizes), getattr(run, measure)
            row += [number(law), number(found), f"{law / found:.2f}"]
            join = max if measure == MEMORY else float.__add__
            sums[measure] = join(sums[measure][0], law), join(sums[measure][1], found)
        rows.append(row)
    last = ["together (memory: the most)"]
    for law, found in sums.values():
        last += [number(law), number(found), f"{law / found:.2f}"]
    return markdown(columns, [*rows, last])


def furthest(fits: Fits, runs: Sequence[Run]) -> dict[str, str]:
    """By measure, the stages whose law is furthest below and above the measurement, in words.

    Stages that take no longer than ``LONG_S`` do not count, unless all are so short.
    """
    long = [run for run in runs if run.cpu_s > LONG_S] or runs
    found = {}
    for measure in (CPU, MEMORY):
        ratios = {run.stage: fits[run.stage][measure].at(run.sizes) / getattr(run, measure) for run in long}
        ends = (min(ratios, key=ratios.__getitem__), max(ratios, key=ratios.__getitem__))
        found[measure] = " to ".join(f"{ratios[stage]:.2f} (`{stage}`)" for stage in ends)
    return found


def sequence(costs: Mapping[str, Cost]) -> str:
    """The cost of each stage for one sequence."""
    columns = (
        "stage",
        "CPU-hours",
        "lowest to highest",
        "memory [GiB]",
        "lowest to highest",
        "disk [GiB]",
        "GPU-hours, as assumed",
    )
    rows = [_sequence_row(stage, cost) for stage, cost in costs.items()]
    everything = list(costs.values())
    total = [
        "together (memory: the most)",
        hours(sum(cost.cpu_s.value for cost in everything)),
        span(hours, sum(cost.cpu_s.low for cost in everything), sum(cost.cpu_s.high for cost in everything)),
        gib(max(cost.memory_mb.value for cost in everything)),
        "",
        gib(sum(cost.disk_mb.value for cost in everything)),
        hours(sum(cost.gpu_s or 0.0 for cost in everything)),
    ]
    return markdown(columns, [*rows, total])


def _sequence_row(stage: str, cost: Cost) -> list[str]:
    memory = cost.memory_mb
    return [
        stage,
        hours(cost.cpu_s.value),
        span(hours, cost.cpu_s.low, cost.cpu_s.high),
        gib(memory.value),
        span(gib, memory.low, memory.high),
        gib(cost.disk_mb.value),
        "none" if cost.gpu_s is None else f"{hours(cost.gpu_s)} ({ON_GPU[stage].replace('_', ' ')})",
    ]


def reach(runs: Sequence[Run], checked: Mapping[str, Sizes], paper: Sizes) -> str:
    """How far the extrapolation goes beyond the measured range of each size."""
    columns = ["size", "measured: least", "most"]
    for name in [*checked, "paper's settings"]:
        columns += [name, "times the most"]
    rows = []
    for size in paper:
        found = [run.sizes[size] for run in runs if size in run.sizes and uses(run.stage, size)]
        row = [size.replace("_", " "), number(min(found)), number(max(found))]
        for target in [*checked.values(), paper]:
            row += _reached(target.get(size), max(found))
        rows.append(row)
    return markdown(columns, rows)


def uses(stage: str, size: str) -> bool:
    """Whether a law of the stage has the size in it."""
    return any(size in term for terms in LAWS[stage].values() for term in terms)


def _reached(value: float | None, most: float) -> list[str]:
    if value is None:
        return ["", ""]
    return [number(value), f"{value / most:.1f}" if value and most else ""]


def number(value: float) -> str:
    """Three significant digits, thousands separated by commas."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def span(text_of: Callable[[float], str], low: float, high: float) -> str:
    """Two values as ``a to b``; one value if both are printed alike."""
    ends = dict.fromkeys((text_of(low), text_of(high)))
    return " to ".join(ends)


def hours(seconds: float) -> str:
    """Hours with three significant digits; ``< 0.01`` for less."""
    return _from_a_hundredth(seconds / 3600)


def gib(mebibytes: float) -> str:
    """GiB, written as ``hours``."""
    return _from_a_hundredth(mebibytes / 1024)


def _from_a_hundredth(value: float) -> str:
    return number(value) if value >= 0.01 else "< 0.01"


def percent(share: float) -> str:
    return f"{share:.0%}"
