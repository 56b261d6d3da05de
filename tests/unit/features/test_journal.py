"""The journal restores complete records and drops truncated, damaged or foreign ones."""

import numpy as np
import pytest

from egosplat.artifacts.provenance import begin, key_of
from egosplat.features.journal import Journal

KEY = b"k" * 32


def record(first: int, rows: int = 3) -> np.ndarray:
    return np.arange(first, first + 2 * rows, dtype=np.float32).reshape(rows, 2)


@pytest.fixture
def output(tmp_path):
    return tmp_path / "view_features.zarr"


def written(output, *records: np.ndarray) -> Journal:
    journal = Journal(output, KEY)
    assert journal.resume() == []
    for one in records:
        journal.append(one)
    return journal


def resumed(output, key: bytes = KEY) -> list[np.ndarray]:
    return Journal(output, key).resume()


def test_records_come_back_in_order(output):
    written(output, record(0), record(10), record(20, rows=1))
    found = resumed(output)
    assert [len(one) for one in found] == [3, 3, 1]
    assert all((a == b).all() for a, b in zip(found, [record(0), record(10), record(20, 1)], strict=True))


def test_nan_is_restored_from_the_journal(output):
    written(output, np.full((1, 2), np.nan, np.float32))
    assert np.isnan(resumed(output)[0]).all()


def test_writing_continues_after_a_truncated_record(output):
    file = written(output, record(0), record(10)).file
    whole = file.read_bytes()
    for cut in (1, 31, 40, 70):
        file.write_bytes(whole[:-cut])
        journal = Journal(output, KEY)
        assert len(journal.resume()) == 1
        journal.append(record(10))
        assert file.read_bytes() == whole


@pytest.mark.parametrize("where", [-1, -40, -60, -75])
def test_records_after_a_flipped_bit_are_discarded(output, where):
    file = written(output, record(0), record(10)).file
    content = bytearray(file.read_bytes())
    content[where] ^= 1
    file.write_bytes(content)
    assert len(resumed(output)) == 1


def test_a_record_of_another_writer_is_not_read_twice(output):
    journal = written(output, record(0))
    other = Journal(output, KEY)
    other.resume()
    other.append(record(10))
    journal.append(record(10))
    assert len(resumed(output)) == 2


def test_a_journal_with_another_key_is_restarted(output):
    written(output, record(0))
    assert resumed(output, b"o" * 32) == []
    assert resumed(output) == []


def test_garbage_is_not_a_journal(output):
    file = written(output).file
    file.write_bytes(b"rubbish")
    assert resumed(output) == []


def test_the_journal_is_removed_with_its_folder(output):
    written(output, record(0)).remove()
    assert list(output.parent.iterdir()) == []


def test_a_full_disk_does_not_stop_the_stage(output, capsys):
    journal = written(output, record(0))
    journal.file = output.parent / "absent" / "journal"
    journal.append(record(10))
    journal.append(record(20))
    assert capsys.readouterr().err.count("could not resume") == 1


def test_a_disk_full_from_the_start_does_not_stop_the_stage(tmp_path, capsys):
    (tmp_path / "file").touch()
    journal = Journal(tmp_path / "file/view_features.zarr", b"key")
    assert journal.resume() == []
    journal.append(record(0))
    assert capsys.readouterr().err.count("could not resume") == 1


def test_cache_key_covers_everything_that_decides_the_result():
    def key(batch: int = 1, origin: str = "real", digest: str = "a", **more: str) -> str:
        return key_of(begin("frames", {"batch": batch}, origin, {"frames.zarr": digest}), more)

    assert key() == key(origin="synthetic")
    assert len({key(), key(batch=2), key(digest="b"), key(hash="c"), key(hash="d")}) == 5
