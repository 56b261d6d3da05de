"""Fixtures of the workflow tests: a local SLURM, and a small disk."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.robustness.small_disk import NoMountError, SmallDisk
from tests.support.local_slurm import LocalSlurm, missing_programs


@pytest.fixture(scope="module")
def slurm() -> Iterator[LocalSlurm]:
    """Run a local SLURM of two nodes for the tests of a module; they are skipped if SLURM is not installed."""
    if absent := missing_programs():
        pytest.skip(
            f"no SLURM here: {', '.join(absent)} not found; Debian's packages are slurmctld, slurmd, slurm-client, munge"
        )
    with tempfile.TemporaryDirectory(prefix="slurm") as folder, LocalSlurm(Path(folder), nodes=2) as running:
        yield running


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[SmallDisk]:
    """Mount a small disk; the test is skipped if mounting is not allowed."""
    try:
        with SmallDisk(tmp_path / "disk") as disk:
            yield disk
    except NoMountError as error:
        pytest.skip(
            f"no disk can be mounted here ({error}); try unshare --user --map-root-user --mount make test"
        )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start with long files: processes of a test run take files in this order. The first makes the finished run that most tests of the
    workflow wait for. The others need none, so that they fill the second core until then."""
    first = [f"test_{name}.py" for name in ("cluster", "rules", "published_architectures", "squares")]
    items.sort(key=lambda item: first.index(item.path.name) if item.path.name in first else len(first))
