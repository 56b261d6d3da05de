"""The judge of bad input: what is not seen here would be counted as well."""

import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"
ERROR = "reading: 3/3 frames\negosplat: mine.yaml: cannot be read as YAML\n"


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return lambda name: importlib.import_module(f"bad_input_bench.{name}")


def case(bench, command=None, **changes):
    told = {"family": "a", "name": "b", "command": command, "named": ("mine.yaml",), "scene": False}
    return bench("cases").Case(**(told | changes))


@pytest.mark.parametrize(
    "status, text, made, digest, verdict",
    [
        (2, ERROR, (), None, "clear"),
        (2, ERROR.replace("mine", "yours"), (), None, "unclear"),
        (2, "egosplat: mine.yaml\n" * 3 + "egosplat: mine.yaml:\n\n\n\n\nx", (), None, "unclear"),
        (2, "egosplat: mine.yaml: " + "x" * 5000, (), None, "unclear"),
        (1, ERROR + "Traceback (most recent call last):\n", (), None, "traceback"),
        (None, "", (), None, "traceback"),
        (2, ERROR, ("work/new.zarr",), None, "harm"),
        (2, ERROR, ("outside/sentinel.txt",), None, "harm"),
        (0, "", (), None, "harm"),
        (2, "Usage: egosplat\nTry 'egosplat -h'\n\nError: --x: mine.yaml\n", (), None, "clear"),
    ],
)
def test_what_bad_input_is_judged_to_be(bench, status, text, made, digest, verdict):
    said = bench("attempts").Said(status, text, made, digest)
    assert bench("verdicts").judge(case(bench), said, None) == verdict


def test_what_is_accepted_needs_a_reason_and_the_same_result(bench):
    judge, Said = bench("verdicts").judge, bench("attempts").Said
    made = ("work/new.zarr",)
    assert judge(case(bench, fine="why"), Said(0, "", made, None), None) == "accepted"
    assert judge(case(bench, fine="why"), Said(0, "", ("outside/canary",), None), None) == "harm"
    compared = case(bench, fine="why", undisturbed=lambda _: [])
    assert judge(compared, Said(0, "", made, "a"), "a") == "accepted"
    assert judge(compared, Said(0, "", made, "b"), "a") == "harm"
    assert judge(compared, Said(0, "", made, None), None) == "harm"


@pytest.fixture
def tried(bench, tmp_path):
    """``tried(function)``: the verdict on a function of the sandbox that is called as a command is."""
    (tmp_path / "finished").mkdir()

    def run(function) -> str:
        one = case(bench, lambda box: lambda: function(box))
        said = bench("attempts").attempt(one, tmp_path / "finished", tmp_path / "try")
        return bench("verdicts").judge(one, said, None)

    return run


def _refuse(_):
    from egosplat.errors import UserError

    raise UserError("mine.yaml: is wrong")


def _connect(_):
    import socket

    socket.create_connection(("localhost", 1))


def test_a_try_is_seen_whatever_it_does(tried):
    import os

    assert tried(_refuse) == "clear"
    assert tried(lambda box: os.system(f"touch {box.canary}")) == "harm"
    assert tried(lambda box: (box.outside / "sentinel.txt").unlink()) == "harm"
    assert tried(_connect) == "harm"
    assert tried(lambda _: 1 // 0) == "traceback"
    assert tried(lambda _: os.kill(os.getpid(), 9)) == "traceback"
    assert tried(lambda box: (box.new.write_text("half"), _refuse(box))) == "harm"


def test_the_page_counts_by_family_and_says_what_is_left(bench):
    Tried = bench("report").Tried
    results = [
        Tried("a", "one", "clear", "", ""),
        Tried("a", "two", "accepted", "", "because"),
        Tried("b", "x`\n", "harm", "", ""),
    ]
    page = bench("report").page(results, seed=3, most=7)
    assert "--seed 3 --most 7" in page and "| a | 2 | 1 | 1 | 0 | 0 | 0 |" in page
    assert "| all | 3 | 1 | 1 | 0 | 0 | 1 |" in page and "- 1 times: because (as `a: two`)." in page
    assert "- harm: b: `x \\n`" in page
