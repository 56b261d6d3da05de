"""Whether what a run writes can be written is asked before it begins."""

import errno
import os
import tempfile

import pytest

from egosplat.errors import UserError
from egosplat.files import check_writable


def test_the_write_probe_leaves_no_file(tmp_path):
    (tmp_path / "results").mkdir()
    check_writable([tmp_path / "results", tmp_path / "logs/deeper"])
    assert [path.name for path in tmp_path.rglob("*")] == ["results"]


@pytest.mark.parametrize(
    ("number", "advice"),
    [(errno.ENOSPC, "Make room"), (errno.EDQUOT, "Make room"), (errno.EROFS, "make it writable")],
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
