"""Which errors are the system's, and what the command line prints for an error."""

import errno
import os
import shlex
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
import torch
from PIL import UnidentifiedImageError

from egosplat.errors import UserError, is_out_of_memory, is_system_error, user_message
from egosplat.pipeline.code_hash import library_version
from tests.support import ROOT


def test_a_library_without_a_wheel_for_this_python_is_named(monkeypatch):
    """Only readers of ADT and the synthetic apartment import it, and no code needs its version."""
    for loaded in [name for name in sys.modules if name.startswith("projectaria_tools.")]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, "projectaria_tools", None)
    for name in ("egosplat.frames.rectify", "egosplat_apartments.adt_format.aria"):
        monkeypatch.delitem(sys.modules, name, raising=False)
        with pytest.raises(ModuleNotFoundError) as caught:
            import_module(name)
        assert 'pip install "egosplat[aria]"' in user_message(caught.value)
    assert user_message(ModuleNotFoundError("no module", name="other")) is None
    assert library_version("no-such-library") == "absent" != library_version("numpy")


@pytest.mark.parametrize("allocate", [np.empty, torch.empty, bytes])
def test_a_lack_of_memory_is_reported(allocate):
    with pytest.raises((MemoryError, RuntimeError)) as caught:
        allocate(2**58)
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
    command, environment = [sys.executable, "-c", LIMITED, *words], os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("egosplat: no memory left (")
    assert "failed to map segment" in line and "ulimit -v allows 600 MB" in line


NONE_LEFT = "no memory left ("


def system(number: int, *file: str) -> OSError:
    return OSError(number, os.strerror(number), *file)


@pytest.mark.parametrize(
    "error, kind, told",
    [
        (UserError("config.yaml: has no key 'a'"), "", "config.yaml: has no key 'a'"),
        (UserError("out of memory"), "", "out of memory"),
        (UserError("(https://me:pw@hub.org/a?token=pw) b"), "", "(https://...@hub.org/a?...) b"),
        (MemoryError(), "memory", NONE_LEFT),
        (system(errno.ENOMEM), "memory", NONE_LEFT),
        *((kind("lib.so: failed to map segment"), "memory", NONE_LEFT) for kind in (OSError, ImportError)),
        (RuntimeError("can't start new thread"), "memory", NONE_LEFT),
        (RuntimeError("could not create a primitive"), "memory", NONE_LEFT),
        (RuntimeError("unable to mmap 8 bytes: Cannot allocate memory (12)"), "memory", NONE_LEFT),
        (torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB."), "memory", NONE_LEFT),
        (system(errno.EACCES, "a"), "system", "a: Permission denied. Check the path and its rights"),
        *((system(number, "a"), "system", "a: ") for number in (errno.EMFILE, errno.EIO, errno.ESTALE)),
        (system(errno.ENOSPC, "a"), "", "a: No space left on device. Make room"),
        (system(errno.ENOSPC), "", "No space left on device. Make room"),
        (OSError(2, "No usable temporary directory"), "", "No usable temporary directory. Make room"),
        # Of content that cannot be read.
        *((system(number, "a"), "", "a: ") for number in (errno.ENOENT, errno.ENOTDIR)),
        # Errors of the program keep their traceback.
        (system(errno.EIO), "system", None),
        (OSError("broken data stream"), "", None),
        (UnidentifiedImageError("a"), "", None),
        (RuntimeError("checksum mismatch"), "", None),
        (ValueError("cannot allocate memory"), "", None),
    ],
)
def test_errors_of_users_and_the_system_are_told_and_those_of_the_program_are_not(error, kind, told):
    assert is_out_of_memory(error) == (kind == "memory") and is_system_error(error) == bool(kind)
    message = user_message(error)
    assert message is None if told is None else message.startswith(told)


@pytest.mark.parametrize(
    "status, limit, told",
    [
        *((137, limit, "killed, most likely for lack of memory") for limit in ("unlimited", "4000000")),
        (139, "4000000", "crashed, most likely because ulimit -v allows 4000000 KiB"),
        (134, "4000000", "crashed, most likely because ulimit -v allows 4000000 KiB"),
        (139, "unlimited", ""),  # a defect, which no advice should hide
        (2, "4000000", ""),
        (0, "unlimited", ""),
    ],
)
def test_a_killed_or_crashed_stage_is_explained(status, limit, told):
    script = shlex.quote(str(ROOT / "workflow/scripts/tell_if_killed.sh"))
    limited = f"ulimit -v {limit}; sh {script} {status}"
    done = subprocess.run(["sh", "-c", limited], capture_output=True, text=True, check=True)
    assert told in done.stderr and bool(told) == bool(done.stderr) and done.stdout == ""
