"""A SLURM for the tests of the cluster profile, where its programs are installed; a disk that can be filled."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.robustness.small_disk import NoMountError, SmallDisk
from tests.support.local_slurm import LocalSlurm, missing_programs


@pytest.fixture(scope="module")
def slurm() -> Iterator[LocalSlurm]:
    """One of our own, for a module's tests; skips them, saying so, where SLURM is absent."""
    if absent := missing_programs():
        pytest.skip(
            f"no SLURM here: {', '.join(absent)} not found; Debian's packages are slurmctld, slurmd, slurm-client, munge"
        )
    with tempfile.TemporaryDirectory(prefix="slurm") as folder, LocalSlurm(Path(folder)) as running:
        yield running


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[SmallDisk]:
    """A disk of its own; skips the test, saying so, where none may be mounted."""
    try:
        with SmallDisk(tmp_path / "disk") as disk:
            yield disk
    except NoMountError as error:
        pytest.skip(
            f"no disk can be mounted here ({error}); try unshare --user --map-root-user --mount make test"
        )
