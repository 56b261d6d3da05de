"""Whether what a run writes can be written is asked before it begins."""

import errno
import os
import tempfile

import pytest

from egosplat.errors import UserError
from egosplat.writable import check_writable, only_looks


def test_nothing_is_left_where_all_is_well(tmp_path):
    (tmp_path / "results").mkdir()
    check_writable([tmp_path / "results", tmp_path / "logs/deeper"])
    assert [path.name for path in tmp_path.rglob("*")] == ["results"]


@pytest.mark.parametrize(
    ("number", "advice"),
    [(errno.ENOSPC, "Make room"), (errno.EDQUOT, "Make room"), (errno.EROFS, "has to be writable")],
)
def test_what_the_system_refuses_is_told_with_the_folder(tmp_path, monkeypatch, number, advice):
    def refuse(**_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", refuse)
    with pytest.raises(UserError, match=rf"{tmp_path}: {os.strerror(number)}\. .*{advice}"):
        check_writable([tmp_path / "results"])


def test_a_file_in_a_folders_place_is_no_folder(tmp_path):
    (tmp_path / "results").touch()
    check_writable([tmp_path / "results/adt"])  # Snakemake says what is wrong with it


@pytest.mark.parametrize(
    "words", [["-n", "a"], ["--dry-run"], ["--report", "x.html"], ["--dag=dot"], ["--lt"]]
)
def test_what_only_looks(words):
    assert only_looks(["snakemake", *words])


@pytest.mark.parametrize("words", [["--cores", "2", "a"], ["--touch"], ["results/adt/scene1/metrics.json"]])
def test_what_writes(words):
    assert not only_looks(["snakemake", *words])
