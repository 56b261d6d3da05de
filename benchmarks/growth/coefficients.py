"""The table of the cost model, ``src/egosplat/cost_model/coefficients.json``."""

from collections.abc import Mapping
from typing import Any

from benchmarks.growth import unfitted
from benchmarks.growth.assumptions import Assumptions
from benchmarks.growth.fitting import Fit
from benchmarks.growth.laws import fit_all
from benchmarks.growth.store import Measured
from egosplat.cost_model.laws import CPU, DISK, MEMORY, Term

DIGITS = 4


def coefficients(measured: Measured) -> dict[str, Any]:
    """The content of the table; ``egosplat.cost_model.laws`` describes it."""
    assumed = Assumptions()
    fits = fit_all(measured.runs)
    paper = unfitted.with_paper_models(fits, measured.published, assumed)
    laws = {stage: _fitted(own, "benchmarks/growth/growth.json") for stage, own in fits.items()}
    units = "benchmarks/growth/growth.json, with the paper's models measured apart"
    for stage in ("segments", "view_features", "metrics"):
        laws[f"{stage}_published"] = _fitted(paper[stage], units)
    for name, law in unfitted.LAWS.items():
        laws[name] = {"source": law.source, CPU: _terms(law.cpu_s), MEMORY: _terms(law.peak_memory_mb)}
        if law.assumed:
            laws[name]["assumed"] = list(law.assumed)
    return {
        "written_by": "python -m benchmarks.growth coefficients benchmarks/growth/growth.json",
        "measured_on": measured.machine,
        "busy_cores": unfitted.BUSY_CORES,
        "rasterizer": unfitted.RASTERIZER,
        "gpu_speedup": {"network": assumed.network_speedup, "rasterizer": assumed.rasterizer_speedup},
        "laws": laws,
    }


def _fitted(own: Mapping[str, Fit], source: str) -> dict[str, Any]:
    return {"source": source} | {
        measure: _terms(own[measure].coefficients) for measure in (CPU, MEMORY, DISK)
    }


def _terms(law: Mapping[Term, float]) -> dict[str, float]:
    return {"*".join(term) or "1": float(f"{factor:.{DIGITS}g}") for term, factor in law.items() if factor}
