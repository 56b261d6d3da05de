"""Whether what a run writes can be written is asked before it begins."""

import errno
import os
import tempfile

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.process_guards import check_writable, only_looks, only_reports


def test_the_write_probe_leaves_no_file(tmp_path):
    (tmp_path / "results").mkdir()
    check_writable([tmp_path / "results", tmp_path / "logs/deeper"])
    assert [path.name for path in tmp_path.rglob("*")] == ["results"]


@pytest.mark.parametrize(
    ("number", "advice"),
    [(errno.ENOSPC, "Make room"), (errno.EDQUOT, "Make room"), (errno.EROFS, "has to be writable")],
)
def test_an_unwritable_folder_is_named_with_the_reason(tmp_path, monkeypatch, number, advice):
    def refuse(**_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", refuse)
    with pytest.raises(UserError, match=rf"{tmp_path}: {os.strerror(number)}\. .*{advice}"):
        check_writable([tmp_path / "results"])


def test_a_file_in_place_of_a_folder_is_reported(tmp_path):
    (tmp_path / "results").touch()
    check_writable([tmp_path / "results/adt"])  # Snakemake says what is wrong with it


@pytest.mark.parametrize(
    "words", [["-n", "a"], ["--dry-run"], ["--report", "x.html"], ["--dag=dot"], ["--lt"]]
)
def test_read_only_commands_skip_the_write_probe(words):
    assert only_looks(["snakemake", *words])


WRITING = [
    ["--cores", "2", "a"],
    ["--touch"],
    ["results/adt/scene1/metrics.json"],
    ["--report", "x.html", "--report-after-run"],
]


@pytest.mark.parametrize("words", WRITING)
def test_writing_commands_run_the_write_probe(words):
    assert not only_looks(["snakemake", *words])


@pytest.mark.parametrize(
    "words", [["--report", "x.html"], ["--report=x.zip"], ["--cores", "1", "--report", "x.html"]]
)
def test_report_commands_skip_the_write_probe(words):
    assert only_reports(["snakemake", *words])


@pytest.mark.parametrize("words", [*WRITING, ["-n"], ["--dry-run"]])
def test_what_does_not_only_report(words):
    """With --report-after-run every result is made first."""
    assert not only_reports(["snakemake", *words])
