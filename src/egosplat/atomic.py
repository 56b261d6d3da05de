"""Folders and files that are whole or absent.

What is being made stands under a hidden name beside its final path and is renamed into place when it is
complete. A killed writer leaves only the hidden name, which the next writer of the same path sweeps away.
"""

import contextlib
import errno
import fcntl
import os
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path

from egosplat.errors import UserError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""A full disk, a quota that is used up, a file larger than may be."""

MAKE_ROOM = "Make room and start the same command again: what is whole already stays"
"""What to do about them."""


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder, which becomes ``path`` when the block ends without error, else vanishes.

    A folder that stands at ``path`` already is replaced at that moment.
    """
    scratch = _begin(path)
    scratch.mkdir()
    with _named(path), _locked(scratch):
        try:
            yield scratch
            _sync(scratch)
            _publish(scratch, path)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield the name of a file to write, which becomes ``path`` when the block ends without error."""
    scratch = _begin(path)
    scratch.touch(exist_ok=False)
    with _named(path), _locked(scratch):
        try:
            yield scratch
            _sync_one(scratch)
            os.replace(scratch, path)
        finally:
            scratch.unlink(missing_ok=True)


@contextlib.contextmanager
def scratch_folder(prefix: str, parent: Path | None = None) -> Iterator[Path]:
    """Yield an empty folder that vanishes when the block ends, and sweep away what killed processes left of such.

    Args:
        prefix: its name begins with, which is for this use alone; parent: where it is made; None: the system's folder of
            temporary files.
    """
    parent = parent or Path(tempfile.gettempdir())
    for left in parent.glob(f"{prefix}*"):
        with contextlib.suppress(OSError), _locked(left):
            shutil.rmtree(left)
    with tempfile.TemporaryDirectory(prefix=prefix, dir=parent) as name, _locked(Path(name)):
        yield Path(name)


def _begin(path: Path) -> Path:
    if path.name in ("", ".."):
        raise UserError(f"{path}: is no name for something new; give --output a name of its own")
    path.parent.mkdir(parents=True, exist_ok=True)
    _sweep(path)
    return _beside(path)


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.tmp")


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name ``path`` in an error of a full disk: the operating system names no file where bytes are written."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            error.filename = str(path)
        raise


@contextlib.contextmanager
def _locked(scratch: Path) -> Iterator[None]:
    """Hold the lock of a file or folder, which ends with the process: how the dead are told from the living."""
    handle = os.open(scratch, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def _sweep(path: Path) -> None:
    """Remove what killed writers of ``path`` left."""
    for left in path.parent.glob(f".{path.name}.????????.tmp"):
        with contextlib.suppress(OSError), _locked(left):
            shutil.rmtree(left) if left.is_dir() else left.unlink()


def _sync(root: Path) -> None:
    """Bring files, then folders, to the disk: a rename must not outlive the bytes it stands for."""
    for folder, _, files in os.walk(root, topdown=False):
        for entry in [*(os.path.join(folder, name) for name in files), folder]:
            _sync_one(entry)


def _sync_one(path: str | Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _publish(scratch: Path, path: Path) -> None:
    """Rename into place; what stood there is moved aside first, so ``path`` is whole or absent throughout.

    Of a link the link is replaced, and what it points to stays.
    """
    if not os.path.lexists(path):
        os.rename(scratch, path)
        return
    aside = _beside(path)
    os.rename(path, aside)
    os.rename(scratch, path)
    shutil.rmtree(aside) if aside.is_dir() and not aside.is_symlink() else aside.unlink()
