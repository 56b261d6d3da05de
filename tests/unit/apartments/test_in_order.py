"""Frames are rendered several at a time, and come in order."""

import threading
import time

import pytest

from egosplat_apartments.stage import in_order, threads


def test_results_come_in_order_and_are_computed_at_the_same_time(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    second = threading.Event()

    def double(item: int) -> int:
        if item == 0:
            assert second.wait(10)
        second.set()
        return 2 * item

    assert list(in_order(double, range(7))) == [0, 2, 4, 6, 8, 10, 12]


def test_few_results_wait(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    begun: list[int] = []
    results = in_order(begun.append, range(100))
    next(results)
    time.sleep(0.05)
    assert len(begun) <= 3
    results.close()
    assert len(begun) <= 3


def test_an_error_ends_the_rest(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        list(in_order(lambda item: 1 // item, [1, 0, 1]))


@pytest.mark.parametrize("given, expected", [("3", 3), ("0", 1)])
def test_threads_are_those_of_the_job(monkeypatch, given, expected):
    monkeypatch.setenv("OMP_NUM_THREADS", given)
    assert threads() == expected
