"""The schedule keeps 3DGS's milestones, scaled or cut to a run's length."""

from dataclasses import replace

import pytest

from egosplat.gaussians.schedule import STOCK, Schedule, cut, scaled


def resets(schedule: Schedule) -> list[int]:
    return [i for i in range(schedule.iterations + 1) if schedule.resets_opacity(i)]


def densifications(schedule: Schedule) -> list[int]:
    return [i for i in range(schedule.iterations + 1) if schedule.densifies(i)]


def test_stock_milestones_are_those_of_3dgs() -> None:
    assert densifications(STOCK) == list(range(600, 15_000, 100))
    assert resets(STOCK) == [3_000, 6_000, 9_000, 12_000]
    assert resets(replace(STOCK, reset_at_start=True)) == [500, 3_000, 6_000, 9_000, 12_000]
    assert not Schedule(reset_at_start=True, densify_from=0).resets_opacity(0)
    assert [STOCK.prunes_large(i) for i in (2_900, 3_000, 3_100)] == [False, False, True]


def test_position_learning_rate_falls_log_linearly_with_extent() -> None:
    assert STOCK.position_lr(0, 2.0) == pytest.approx(3.2e-4)
    assert STOCK.position_lr(15_000, 1.0) == pytest.approx(1.6e-5)
    assert STOCK.position_lr(30_000, 1.0) == pytest.approx(1.6e-6)
    assert STOCK.position_lr(90_000, 1.0) == pytest.approx(1.6e-6)


def test_sh_degree_grows_up_to_the_highest() -> None:
    degrees = [STOCK.sh_degree(i, 3) for i in (1, 999, 1_000, 2_500, 3_000, 30_000)]
    assert degrees == [0, 0, 1, 2, 3, 3]
    assert STOCK.sh_degree(30_000, 1) == 1


def test_scaled_schedules_keep_fractions_but_no_interval_is_short_unless_the_run_is() -> None:
    short, shortest = scaled(STOCK, 7_000), scaled(STOCK, 700)
    assert (short.densify_from, short.densify_until, short.densify_every) == (500, 3_500, 100)
    assert (short.sh_interval, short.position_lr_steps) == (1_000, 7_000)
    assert (shortest.densify_from, shortest.densify_until, shortest.densify_every) == (140, 350, 35)
    assert shortest.sh_interval == 100
    assert resets(short) == []
    assert not any(short.prunes_large(i) for i in range(1, 7_001))
    assert resets(scaled(STOCK, 12_000)) == [3_000]


@pytest.mark.parametrize("iterations", [1, 2, 3, 10, 31, 300, 999, 4_000, 7_000, 30_000, 100_001])
def test_density_control_ends_by_half_time_and_no_reset_comes_late(iterations: int) -> None:
    schedule = scaled(STOCK, iterations)
    assert schedule.densify_until <= max(iterations / 2, 1)
    assert all(i <= schedule.densify_until - 3_000 for i in resets(schedule))
    assert schedule.position_lr(iterations, 1.0) == pytest.approx(1.6e-6)


def test_a_cut_schedule_is_the_beginning_of_the_stock_schedule():
    """EgoLifter's 7,000 iterations: growth until the end, 3DGS's learning rates, resets at 500 and 3,000."""
    begun = cut(replace(STOCK, reset_at_start=True), 7_000)
    assert resets(begun) == [500, 3_000]
    grows = densifications(begun)
    assert (grows[0], grows[-1]) == (600, 6_900)
    assert [begun.prunes_large(i) for i in (3_000, 3_100)] == [False, True]
    for iteration in (1, 3_000, 7_000):
        assert begun.position_lr(iteration, 2.0) == STOCK.position_lr(iteration, 2.0)
    assert not any(densifications(cut(STOCK, iterations)) for iterations in (1, 499, 500, 501))
    assert not any(resets(cut(begun, iterations)) for iterations in (1, 499, 500)), (
        "nothing recovers after it"
    )
    assert cut(STOCK, STOCK.iterations) == STOCK and cut(STOCK, 40_000).densify_until == STOCK.densify_until
