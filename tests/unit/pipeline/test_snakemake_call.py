"""Targets and options of a Snakemake call, read with its own parser."""

import pytest

from egosplat.pipeline.snakemake_call import read_call


@pytest.mark.parametrize(
    "words", [["-n", "a"], ["--dry-run"], ["--report", "x.html"], ["--dag=dot"], ["--lt"]]
)
def test_a_call_that_makes_no_results(words):
    """Protects looking at a workflow in a folder that cannot be written."""
    assert not read_call(words).makes_results


WRITING = [
    ["--cores", "2", "a"],
    ["--touch"],
    ["results/adt/scene1/metrics.json"],
    ["--report", "x.html", "--report-after-run"],
]


@pytest.mark.parametrize("words", WRITING)
def test_a_call_that_makes_results(words):
    """Protects the check of folders before a run."""
    call = read_call(words)
    assert call.makes_results and not call.dry_run and not call.reports


@pytest.mark.parametrize(
    "words", [["--report", "x.html"], ["--report=x.zip"], ["--cores", "1", "--report", "x.html"]]
)
def test_a_call_that_reports(words):
    """Protects the report of existing results: with --report-after-run every result is made first."""
    assert read_call(words).reports


@pytest.mark.parametrize("words", [["-n"], ["--dry-run"], ["-np", "--cores", "2"]])
def test_a_dry_run(words):
    """Protects the notices of a plan, also with combined short options."""
    call = read_call(words)
    assert call.dry_run and not call.makes_results and not call.reports


def test_values_of_options_are_no_targets():
    """Protects the messages about targets: a path after --config or --forcerun is no target."""
    words = ["--cores", "2", "--forcerun", "results/a/b/c.zarr", "--config", "preset=draft"]
    words += ["--", "results/a/b/d.zarr", "all"]
    assert read_call(words).targets == ("results/a/b/d.zarr", "all")
