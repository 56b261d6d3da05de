"""The growth benchmark: fitting, the extrapolation to the paper's settings, and the table of the cost model."""

import importlib
import random

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.common import ROOT
from egosplat.cost_model.laws import evaluate, table

TRUE = {(): 2.0, ("frames",): 0.5, ("frames", "pixels"): 3e-4}
"""Coefficients by term."""


@pytest.fixture
def bench():
    return lambda name: importlib.import_module(f"benchmarks.growth.{name}")


def scenes(count: int = 8) -> list[dict[str, float]]:
    rng = np.random.default_rng(0)
    return [{"frames": float(f), "pixels": float(p)} for f, p in rng.integers(5, 500, (count, 2))]


def truth(own: dict[str, float]) -> float:
    return 2.0 + 0.5 * own["frames"] + 3e-4 * own["frames"] * own["pixels"]


def test_known_coefficients_are_found_again(bench):
    """The fit recovers exact coefficients, also far outside the measured sizes."""
    points = scenes()
    found = bench("fitting").fit(list(TRUE), points, [truth(own) for own in points])
    assert found.coefficients == pytest.approx(TRUE, rel=1e-6)
    assert found.errors == pytest.approx([0.0] * len(points), abs=1e-9)
    assert found.left_out == pytest.approx([0.0] * len(points), abs=1e-6)
    far = {"frames": 1e4, "pixels": 2e6}
    assert found.at(far) == pytest.approx(truth(far))
    assert found.between(far) == pytest.approx((truth(far), truth(far)))


def test_no_coefficient_is_negative(bench):
    """A cost cannot fall with a size."""
    points = [{"frames": float(f), "pixels": 1.0} for f in range(1, 8)]
    falling = [10.0 / own["frames"] for own in points]
    found = bench("fitting").fit([(), ("frames",)], points, falling)
    assert min(found.coefficients.values()) >= 0
    assert all(min(law.values()) >= 0 for law in found.without)


def test_known_coefficients_are_not_fitted(bench):
    """A coefficient that follows from the code stays, and the others are fitted to what it leaves."""
    points = scenes()
    measured = [truth(own) for own in points]
    found = bench("fitting").fit(list(TRUE), points, measured, {("frames",): 0.5})
    assert found.coefficients == pytest.approx(TRUE, rel=1e-6) and found.coefficients[("frames",)] == 0.5
    wrong = bench("fitting").fit(list(TRUE), points, measured, {("frames",): 0.7})
    assert wrong.coefficients[("frames",)] == 0.7
    assert all(law[("frames",)] == 0.7 for law in wrong.without)
    assert min(wrong.coefficients.values()) >= 0


def test_residuals_are_relative_to_the_measured_value(bench):
    """Small scenes count as much as large ones."""
    # Equal shares of error above and below: a constant lies between, nearer to the small values.
    found = bench("fitting").fit([()], [{}, {}], [1.0, 3.0])
    # The least of (c - 1)^2 + (c / 3 - 1)^2.
    assert found.coefficients[()] == pytest.approx((1 + 1 / 3) / (1 + 1 / 9))


def test_errors_and_held_out_errors_match_their_definition(bench):
    """docs/running.md prints them."""
    fitting = bench("fitting")
    points = scenes()
    measured = [truth(own) for own in points]
    measured[3] *= 1.5
    found = fitting.fit(list(TRUE), points, measured)
    again = [evaluate(found.coefficients, own) / value - 1 for own, value in zip(points, measured, strict=True)]  # fmt: skip
    assert found.errors == pytest.approx(again)
    rest = [own for index, own in enumerate(points) if index != 3]
    without = fitting.fit(list(TRUE), rest, [truth(own) for own in rest])
    assert (
        found.left_out[3] == pytest.approx(without.at(points[3]) / measured[3] - 1) == pytest.approx(-1 / 3)
    )
    assert fitting.median_and_worst([0.1, -0.5, 0.2]) == pytest.approx((0.2, 0.5))
    low, high = found.between(points[3])
    assert low <= truth(points[3]) * (1 + 1e-9) and high > truth(points[3])


def test_a_term_that_no_point_has_gets_the_coefficient_0(bench):
    """Otherwise it would be NaN."""
    points = [{"frames": float(f), "joint": 0.0} for f in range(1, 5)]
    found = bench("fitting").fit(
        [("frames",), ("frames", "joint")], points, [own["frames"] for own in points]
    )
    assert found.coefficients[("frames", "joint")] == 0.0


def test_the_design_has_more_points_than_terms(bench):
    """Each law can be fitted with one point left out."""
    design, laws = bench("design"), bench("laws")
    names = [point.name for point in design.POINTS]
    assert len(set(names)) == len(names)
    assert set(laws.LAWS) == set(design.STAGES)
    for stage, own in laws.LAWS.items():
        points = [point for point in design.POINTS if stage in point.stages]
        assert len(points) > max(map(len, own.values())), stage


def made_up(bench, seed: int = 0):
    """Runs as if every stage took 1 s, and 10 MiB, a frame and million pixels."""
    rng, design, laws = random.Random(seed), bench("design"), bench("laws")
    sizes = bench("extrapolation").paper_sizes(bench("assumptions").Assumptions())
    points = {}
    for point in design.POINTS:
        own = {name: value / 1000 * rng.uniform(0.5, 2.0) for name, value in sizes.items()}
        cost = own["frames"] * own["pixels"] / 1e6
        points[point.name] = [
            bench("readings").Run(stage, point.name, own, cost, 500 + 10 * cost, cost) for stage in laws.LAWS
        ]
    return points


@pytest.fixture
def measured(bench):
    units = {"picture": 10.0, "prompt": 0.1, "tracked": 2.0, "crop": 0.5}
    points = made_up(bench)
    checks = {"adt/scene1": made_up(bench, 1)["center"]}
    return bench("store").Measured("Abacus, 2 cores", points, {}, checks, units)


def test_measured_unit_costs_replace_those_of_the_small_models(bench, measured):
    """A hand-computed sum of frames, prompts and tracked instances."""
    extrapolation, laws = bench("extrapolation"), bench("laws")
    assumed = bench("assumptions").Assumptions(frames=100, instances=10, visible=0.25, evaluated=0)
    fits = laws.fit_all(measured.runs)
    # With nothing fitted left but the models' own costs.
    fits["segments"]["cpu_s"].coefficients[("kept", "pixels")] = 0.0
    costs = extrapolation.costs_of(
        bench("unfitted").with_paper_models(fits, measured.published, assumed),
        ["segments"],
        extrapolation.paper_sizes(assumed),
        assumed,
    )
    # 100 pictures, 32 x 32 prompts, 10 instances looked for in half of the frames: a quarter, and a third of the rest.
    assert costs["segments"].cpu_s.value == pytest.approx(100 * 10.0 + 1024 * 0.1 + 100 * 10 * 0.5 * 2.0)


def test_gpu_hours_follow_from_the_assumptions(bench, measured):
    """Twice the speed-up halves them."""
    extrapolation, laws = bench("extrapolation"), bench("laws")
    fits = laws.fit_all(measured.runs)

    def of(**changes):
        assumed = bench("assumptions").Assumptions(**changes)
        stages = extrapolation.stages_of(extrapolation.paper_config())
        costs = extrapolation.costs_of(fits, stages, extrapolation.paper_sizes(assumed), assumed)
        return costs, extrapolation.on_cluster(costs, assumed)

    costs, cluster = of(sequences=9, gpus=4, network_speedup=10.0, rasterizer_speedup=5.0)
    assert costs["segments"].gpu_s == pytest.approx(costs["segments"].cpu_s.value / 10)
    assert costs["splats"].gpu_s == pytest.approx(costs["splats"].cpu_s.value / 5)
    assert costs["frames"].gpu_s is None
    assert cluster.rounds == 3
    beside = sum(cost.cpu_s.value for cost in costs.values() if cost.gpu_s is None)
    assert cluster.wall_s == pytest.approx(3 * (cluster.gpu_s / 9 + beside))
    assert cluster.cpu_s == pytest.approx(9 * sum(cost.cpu_s.value for cost in costs.values()))
    assert of(network_speedup=20.0)[0]["segments"].gpu_s == pytest.approx(of(network_speedup=10.0)[0]["segments"].gpu_s / 2)  # fmt: skip


def test_the_shipped_table_is_the_one_that_the_measurements_give(bench):
    """After a new measurement the table must be written again: jobs and doctor read it, not growth.json."""
    measured = bench("store").load(ROOT / "benchmarks/growth/growth.json")
    written, shipped = bench("coefficients").coefficients(measured), table()
    assert shipped | {"laws": None} == written | {"laws": None}
    assert shipped["laws"].keys() == written["laws"].keys()
    for name, law in written["laws"].items():
        for measure, terms in law.items():
            found = shipped["laws"][name][measure]
            # Another SciPy may round the last digit otherwise.
            assert found == (pytest.approx(terms, rel=1e-2) if isinstance(terms, dict) else terms), (
                name,
                measure,
            )


def test_the_report_takes_each_assumption_as_an_option(bench, measured, tmp_path, monkeypatch):
    """The page can be written for other assumptions."""
    growth = importlib.import_module("benchmarks.growth.__main__")
    bench("store").save(tmp_path / "growth.json", measured)
    done = CliRunner().invoke(growth.main, ["report", str(tmp_path / "growth.json"), "--frames", "7200"])
    assert done.exit_code == 0, done.output
    assert "7,200 frames of 1408" in done.output


def test_measured_points_are_not_measured_again(bench, measured, tmp_path, monkeypatch):
    """An interrupted measurement resumes at the next point."""
    growth, store, path = (
        importlib.import_module("benchmarks.growth.__main__"),
        bench("store"),
        tmp_path / "growth.json",
    )
    lost = {name: measured.points.pop(name) for name in ("frames-12", "joint-3")}
    store.save(path, measured)
    asked = []

    def stopped(_, point):
        asked.append(point.name)
        if point.name == "joint-3" and len(asked) < 3:
            raise KeyboardInterrupt
        return lost[point.name]

    monkeypatch.setattr(growth, "_measured", stopped)
    assert CliRunner().invoke(growth.main, ["measure", str(path)]).exit_code == 1
    done = CliRunner().invoke(growth.main, ["measure", str(path)])
    assert done.exit_code == 0, done.output
    assert asked == ["frames-12", "joint-3", "joint-3"]
    assert store.load(path).points == measured.points | lost
