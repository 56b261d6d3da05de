"""Tests of the times of stages in two checkouts: processor time of a command, flags, rows."""

import sys
from pathlib import Path

import pytest

from benchmarks.common import ROOT, cpu_seconds_of
from benchmarks.stage_times.__main__ import DECIDED, Checkout, input_flags, row
from egosplat.errors import UserError

BUSY = "import time\nwhile time.process_time() < {}: pass"


def test_processor_time_counts_processes_that_a_command_waits_for(tmp_path: Path) -> None:
    nested = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BUSY.format(0.4)!r}])"
    short = cpu_seconds_of([sys.executable, "-c", BUSY.format(0.1)], tmp_path)
    assert 0.1 <= short < 0.4 <= cpu_seconds_of([sys.executable, "-c", nested], tmp_path)


def test_a_command_that_fails_is_reported_with_its_output(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such thing"):
        cpu_seconds_of([sys.executable, "-c", "raise SystemExit('no such thing')"], tmp_path)


def test_a_stage_gets_the_files_of_the_scene_that_its_command_asks_for(tmp_path: Path) -> None:
    for name in ("frames.zarr", "poses.zarr", "survey.json"):
        (tmp_path / name).mkdir()
    flags = Checkout(ROOT).path_flags("splats")
    assert {"--frames", "--poses", "--survey", "--masks", "--output"} <= set(flags)
    given = input_flags(flags, tmp_path)
    assert given == [
        *("--frames", str(tmp_path / "frames.zarr")),
        *("--poses", str(tmp_path / "poses.zarr")),
        *("--survey", str(tmp_path / "survey.json")),
    ]


def test_what_the_workflow_decides_is_a_valid_option() -> None:
    """The stage ends because its files are missing, not because of what is set."""
    for stage, words in DECIDED.items():
        with pytest.raises(UserError, match="Missing option '--frames'"):
            Checkout(ROOT).seconds(stage, *words, "--output", "x.zarr")


def test_a_checkout_without_a_stage_has_no_flags_and_no_ratio() -> None:
    assert Checkout(ROOT).path_flags("no-such-stage") == []
    assert row("`instances`", [0.0, 3.0]) == ["`instances`", "0.0", "3.0", "-"]
    assert row("`splats`", [4.0, 3.0]) == ["`splats`", "4.0", "3.0", "0.75"]
