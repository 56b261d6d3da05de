"""A disk that is full or cannot be written: a plain error, nothing whole is lost, and with room the same command goes on."""

import shutil
from pathlib import Path

import pytest

from egosplat.artifacts.lineage import check_tree

SCENE = Path("results/adt/scene1")


@pytest.fixture
def on_small_disk(finished, small_disk):
    """A private copy of the finished run on a disk of its own, without the recording."""
    folder = Path(shutil.copytree(finished.folder, small_disk.folder / "work", symlinks=True))
    shutil.rmtree(folder / SCENE / "recording")
    return type(finished)(folder)


def refused(workdir, *targets: str) -> str:
    done = workdir.snakemake("--", *targets)
    said = done.stdout + done.stderr
    assert done.returncode != 0, said
    assert "Traceback" not in said, said
    (told,) = {line for line in map(str.strip, said.splitlines()) if line.startswith("egosplat: ")}
    return told


@pytest.mark.slow
def test_a_disk_that_fills_during_a_stage_is_reported(on_small_disk, small_disk):
    target = SCENE / "recording"
    small_disk.leave(2**20 + 2**17)
    told = refused(on_small_disk, str(target))
    assert told.startswith(f"egosplat: {target}: No space left on device. Make room")
    assert not (on_small_disk.folder / target).exists()
    assert not list((on_small_disk.folder / SCENE).glob(".*")), "something half made was left"
    assert not any(check_tree(on_small_disk.folder / "results", lambda _: None).values())

    small_disk.enlarge()
    on_small_disk.run(str(target))
    assert (on_small_disk.folder / target / "video.vrs").exists()


def test_colmap_is_not_begun_on_a_full_disk(small_disk, finished, tmp_path, monkeypatch, run_command):
    """Where SQLite finds no room COLMAP takes the process down."""
    monkeypatch.setenv("TMPDIR", str(small_disk.folder))
    monkeypatch.setattr("tempfile.tempdir", None)  # so that it is computed again
    left = small_disk.folder / "egosplat-colmap-of-the-dead"
    left.mkdir()
    small_disk.leave(2**24)
    scene = finished.folder / SCENE
    words = ["--recording", scene / "recording", "--frames", scene / "frames.zarr", "--set", "method=colmap"]
    words += ["--output", tmp_path / "poses.zarr"]
    status, _, said = run_command("poses", *words)
    assert status and f"egosplat: {small_disk.folder}: 16 MiB are free, and COLMAP needs 32" in said
    assert not list(small_disk.folder.iterdir())
