"""A SLURM for the tests of the cluster profile, where its programs are installed."""

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="module")
def slurm() -> Iterator["LocalSlurm"]:  # noqa: F821
    """One of our own, for a module's tests; skips them, saying so, where SLURM is absent."""
    from local_slurm import LocalSlurm, missing_programs

    if absent := missing_programs():
        pytest.skip(
            f"no SLURM here: {', '.join(absent)} not found; Debian's packages are slurmctld, slurmd, slurm-client, munge"
        )
    with tempfile.TemporaryDirectory(prefix="slurm") as folder, LocalSlurm(Path(folder)) as running:
        yield running
