"""What goes wrong outside of the program is told in a line; an error in it keeps its traceback."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from PIL import UnidentifiedImageError

from egosplat.errors import UserError
from egosplat.plain_errors import plain

MORE_THAN_THERE_IS = 2**60


def test_a_users_mistake_is_its_own_message():
    assert plain(UserError("config.yaml: has no key 'a'")) == "config.yaml: has no key 'a'"


def test_a_file_that_may_not_be_read_is_named():
    error = PermissionError(errno.EACCES, "Permission denied", "a.png")
    assert plain(error) == "a.png: Permission denied. Check the path and its rights"


@pytest.mark.parametrize("filename", ["results/splats.zarr", None])
def test_a_full_disk(filename):
    told = plain(OSError(errno.ENOSPC, "No space left on device", filename))
    where = f"{filename}: " if filename else ""
    assert (
        told
        == f"{where}No space left on device. Make room and start the same command again: what is whole already stays"
    )


@pytest.mark.parametrize(
    "allocate",
    [
        lambda: np.empty(MORE_THAN_THERE_IS, np.uint8),
        lambda: torch.empty(MORE_THAN_THERE_IS, dtype=torch.uint8),
        lambda: bytes(MORE_THAN_THERE_IS),
    ],
)
def test_a_lack_of_memory(allocate):
    with pytest.raises((MemoryError, RuntimeError)) as caught:
        allocate()
    told = plain(caught.value)
    assert told.startswith("no memory left (") and "scale.md" in told and "\n" not in told


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        OSError("libraster.so: failed to map segment from shared object"),
        ImportError("libtorch_cpu.so: failed to map segment from shared object"),
    ],
)
def test_a_lack_of_memory_for_processes_and_libraries(error):
    assert plain(error) == f"no memory left ({error}). Free some, or see docs/scale.md for what takes less"


LIMITED = """
import resource
resource.setrlimit(resource.RLIMIT_AS, (600_000_000, resource.RLIM_INFINITY))
from egosplat.cli import main
main()
"""


def test_a_limit_on_addresses_is_named(tmp_path):
    """Of which libraries take more than most stages ever fill."""
    words = ["splats", "--frames", "a", "--poses", "b", "--output", "c"]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, *words],
        cwd=tmp_path,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("egosplat: no memory left (")
    assert "failed to map segment" in line and "ulimit -v allows 600 MB" in line


def test_a_gpus_lack_of_memory():
    assert "no memory left" in plain(
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\n...")
    )


@pytest.mark.parametrize(
    "error",
    [ValueError("a"), RuntimeError("a"), UnidentifiedImageError("a"), OSError("a"), OSError(errno.EIO, "a")],
)
def test_what_keeps_its_traceback(error):
    assert plain(error) is None
