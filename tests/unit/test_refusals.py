"""What the system refuses is told from what a file holds."""

import errno

import pytest
import torch

from egosplat.errors import UserError
from egosplat.refusals import lacks_memory, refused


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
def test_memory(error):
    assert lacks_memory(error) and refused(error)


@pytest.mark.parametrize("number", [errno.EACCES, errno.EMFILE, errno.EIO, errno.ESTALE])
def test_rights_open_files_and_file_systems(number):
    error = OSError(number, "refused", "a")
    assert refused(error) and not lacks_memory(error)


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
def test_what_a_file_holds(error):
    assert not refused(error)
