"""Which errors are the system's, and what the command line prints for an error."""

import errno
import os
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
import torch
from PIL import UnidentifiedImageError

from egosplat.errors import UserError, is_out_of_memory, is_system_error, user_message
from egosplat.pipeline.code_hash import library_version

MORE_THAN_THERE_IS = 2**60


def test_a_user_error_prints_its_message_only():
    assert user_message(UserError("config.yaml: has no key 'a'")) == "config.yaml: has no key 'a'"


def test_a_library_without_a_wheel_for_this_python_is_named(monkeypatch):
    """Only readers of ADT and the synthetic apartment import it, and no code needs its version."""
    for loaded in [name for name in sys.modules if name.startswith("projectaria_tools.")]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, "projectaria_tools", None)
    for name in ("egosplat.frames.rectify", "egosplat_apartments.adt_format.aria"):
        monkeypatch.delitem(sys.modules, name, raising=False)
        with pytest.raises(ModuleNotFoundError) as caught:
            import_module(name)
        assert "pip install 'projectaria-tools>=2.3'" in user_message(caught.value)
    assert user_message(ModuleNotFoundError("no module", name="other")) is None
    assert library_version("no-such-library") == "absent" != library_version("numpy")


def test_a_file_that_may_not_be_read_is_named():
    error = PermissionError(errno.EACCES, "Permission denied", "a.png")
    assert user_message(error) == "a.png: Permission denied. Check the path and its rights"


@pytest.mark.parametrize("filename", ["results/splats.zarr", None])
def test_a_full_disk_is_reported(filename):
    told = user_message(OSError(errno.ENOSPC, "No space left on device", filename))
    where = f"{filename}: " if filename else ""
    assert (
        told
        == f"{where}No space left on device. Make room and start the same command again: complete results are kept"
    )


@pytest.mark.parametrize(
    "allocate",
    [
        lambda: np.empty(MORE_THAN_THERE_IS, np.uint8),
        lambda: torch.empty(MORE_THAN_THERE_IS, dtype=torch.uint8),
        lambda: bytes(MORE_THAN_THERE_IS),
    ],
)
def test_a_lack_of_memory_is_reported(allocate):
    with pytest.raises((MemoryError, RuntimeError)) as caught:
        allocate()
    told = user_message(caught.value)
    assert told.startswith("no memory left (") and "running.md" in told and "\n" not in told


LIMITED = """
import resource
resource.setrlimit(resource.RLIMIT_AS, (600_000_000, resource.RLIM_INFINITY))
from egosplat.cli import main
main()
"""


def test_a_limit_on_addresses_is_named(tmp_path):
    """The libraries reserve more addresses than most stages ever fill."""
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


@pytest.mark.parametrize(
    "error",
    [ValueError("a"), RuntimeError("a"), UnidentifiedImageError("a"), OSError("a"), OSError(errno.EIO, "a")],
)
def test_program_errors_keep_their_traceback(error):
    assert user_message(error) is None


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        OSError("libraster.so: failed to map segment from shared object"),
        ImportError("libtorch_cpu.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
        RuntimeError("could not create a primitive"),
        RuntimeError("unable to mmap 8 bytes from file <a>: Cannot allocate memory (12)"),
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB."),
    ],
)
def test_a_lack_of_memory_is_a_system_error(error):
    assert is_out_of_memory(error) and is_system_error(error)


@pytest.mark.parametrize("number", [errno.EACCES, errno.EMFILE, errno.EIO, errno.ESTALE])
def test_missing_rights_and_faults_of_a_file_system_are_system_errors(number):
    error = OSError(number, "refused", "a")
    assert is_system_error(error) and not is_out_of_memory(error)


@pytest.mark.parametrize(
    "error",
    [
        FileNotFoundError(errno.ENOENT, "No such file", "a"),
        NotADirectoryError(errno.ENOTDIR, "Not a directory", "a"),
        OSError("broken data stream"),
        RuntimeError("checksum mismatch"),
        ValueError("cannot allocate memory"),
        UserError("out of memory"),
    ],
)
def test_unreadable_content_is_not_a_system_error(error):
    assert not is_system_error(error)
