"""Checkpoints: whole, of the same run, or not used."""

from dataclasses import replace

import pytest
import torch

from egosplat.artifacts import checkpoint as module
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.provenance import begin, key_of

NOW = 1e-9


def state(value: float = 1.0) -> dict:
    return {"tensor": torch.full((3, 2), value), "list": [1, 2.5, float("nan")], "none": None, "text": "a"}


def saved(folder, key: str = "key") -> Checkpoint:
    checkpoint = Checkpoint(folder / "splats.zarr", key, NOW)
    checkpoint.save_if_due(state)
    return checkpoint


def test_the_last_saved_state_is_restored(tmp_path):
    checkpoint = saved(tmp_path)
    loaded = Checkpoint(tmp_path / "splats.zarr", "key", NOW).load()
    assert torch.equal(loaded["tensor"], state()["tensor"])
    assert loaded["list"][:2] == [1, 2.5] and loaded["none"] is None and loaded["text"] == "a"
    checkpoint.save_if_due(lambda: state(2.0))
    assert float(checkpoint.load()["tensor"][0, 0]) == 2.0


def test_a_checkpoint_is_one_hidden_file_and_can_be_removed(tmp_path):
    checkpoint = saved(tmp_path)
    checkpoint.save_if_due(lambda: state(2.0))
    assert [path.name for path in tmp_path.iterdir()] == [".splats.zarr.checkpoint"]
    assert len(list(checkpoint.file.parent.iterdir())) == 1
    (checkpoint.file.parent / ".state.12345678.tmp").touch()  # what a killed writer leaves
    for _ in range(2):
        checkpoint.remove()
        assert not list(tmp_path.iterdir()) and checkpoint.load() is None
    waiting = Checkpoint(tmp_path / "splats.zarr", "key", 3600.0)
    waiting.save_if_due(lambda: pytest.fail("asked for the state before its interval"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("write_s, saves", [(1.0, 9), (6.0, 5), (60.0, 1)])
def test_a_slow_write_is_repeated_less_often(tmp_path, monkeypatch, write_s, saves):
    clock, written = [0.0], []
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])

    def write(file, key, saved) -> None:
        written.append(saved)
        clock[0] += write_s

    monkeypatch.setattr(module, "write_state", write)
    checkpoint = Checkpoint(tmp_path / "splats.zarr", "key")
    while clock[0] < 600.0:
        clock[0] += 1.0
        checkpoint.save_if_due(state)
    assert len(written) == saves


def test_a_full_disk_does_not_end_training(tmp_path, capsys, monkeypatch):
    checkpoint = saved(tmp_path)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("egosplat.files._sync_one", full)
    checkpoint.save_if_due(lambda: state(2.0))
    assert "no checkpoint" in capsys.readouterr().err
    assert float(checkpoint.load()["tensor"][0, 0]) == 1.0  # the last whole one


@pytest.mark.parametrize("position, length", [(0, None), (40, None), (-1, None), (0, 0), (0, 10), (0, 200)])
def test_a_flipped_bit_a_lost_end_and_another_run_are_detected(tmp_path, capsys, position, length):
    checkpoint = saved(tmp_path)
    assert Checkpoint(tmp_path / "splats.zarr", "other", NOW).load() is None
    assert "other options, inputs or code" in capsys.readouterr().err
    content = bytearray(checkpoint.file.read_bytes())
    content[position] ^= length is None
    checkpoint.file.write_bytes(content[:length])
    assert checkpoint.load() is None
    assert "damaged" in capsys.readouterr().err


def test_cache_key_covers_everything_that_decides_the_result():
    made = begin("splats", {"seed": 0, "iterations": 5}, "real", {"frames.zarr": "abc"})
    later = replace(made, created="later", started=0.0, origin="synthetic")
    assert key_of(made) == key_of(later)
    changes = [
        {"options": {"seed": 1, "iterations": 5}},
        {"inputs": {"frames.zarr": "abd"}},
        {"code": "other"},
        {"versions": {**made.versions, "torch": "0"}},
    ]
    keys = {key_of(made), *(key_of(replace(made, **change)) for change in changes)}
    assert len(keys | {key_of(made, {"hash": "c"}), key_of(made, {"hash": "d"})}) == 7
