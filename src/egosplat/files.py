"""Atomic files and directories, JSON files, and what a command may write."""

import contextlib
import fcntl
import json
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from egosplat.errors import MAKE_ROOM, NO_ROOM, UserError, reraise_as, user_message


@contextlib.contextmanager
def atomic_directory(path: Path) -> Iterator[Path]:
    """Yield an empty directory that replaces ``path`` when the block ends without error; otherwise it is removed."""
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
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield the name of a file to write; it becomes ``path`` when the block ends without error."""
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
def alone(folder: Path, what: str, *, wait: bool = False) -> Iterator[None]:
    """Let one process at a time make ``what`` in a folder, in which nothing tells of it; others ``wait`` (UserError: names it)."""
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(_locked(folder, wait=wait))
        except BlockingIOError:
            device, inode = folder.stat().st_dev, folder.stat().st_ino
            mark = f"{os.major(device):02x}:{os.minor(device):02x}:{inode} "
            found = re.search(f"([1-9][0-9]*) {mark}", Path("/proc/locks").read_text())
            whose = f"process {found[1]}: wait for it, or kill {found[1]}" if found else "another process"
            raise UserError(f"{what}: is being made by {whose}") from None
        yield


@contextlib.contextmanager
def scratch_directory(prefix: str, parent: Path | None = None) -> Iterator[Path]:
    """Yield an empty directory below ``parent``, or the system's for temporary files, that is removed when the block ends. Those
    that killed processes left are removed, too: no other use may share the ``prefix`` of its name."""
    parent = parent or Path(tempfile.gettempdir())
    _sweep(filter(Path.is_dir, parent.glob(f"{prefix}*")))
    with tempfile.TemporaryDirectory(prefix=prefix, dir=parent) as name, _locked(Path(name)):
        yield Path(name)


def read_user_text(path: Path) -> str:
    """The content of a user's text file in UTF-8, with or without a byte order mark. Ends of lines stay as they are
    (FileNotFoundError: it does not exist; UserError: it cannot be read, is a pipe, or is not UTF-8)."""
    if path.is_fifo():
        # A pipe gives its content to the first reader; each job of a run is one more.
        raise UserError(f"{path}: is a pipe, which can be read once only; give a file")
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(
            f"{path}: is no text in UTF-8 (byte {error.start} is {error.object[error.start]:#x}); save it as UTF-8"
        ) from None
    except FileNotFoundError:
        raise
    except OSError as error:
        raise UserError(user_message(error) or f"{path}: {error}") from None


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all."""
    with atomic_file(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def write_json(path: Path, document: Any) -> None:
    """Write a document as JSON with sorted keys, whole or not at all (ValueError: a number is not finite)."""
    write_text(path, json.dumps(document, indent=1, sort_keys=True, allow_nan=False) + "\n")


def expand_home(path: str) -> Path:
    """Get a path with ``~`` as the home folder; it stays where no user of that name has one."""
    return Path(os.path.expanduser(path))


def user_cache() -> Path:
    """The user's folder of what egosplat can make again: below ``XDG_CACHE_HOME``, or ``~/.cache``."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "egosplat"


def read_users_json(path: Path, advice: str = "") -> Any:
    """The content of a user's JSON file (UserError: it cannot be read; ends with the advice)."""

    def told(error: Exception) -> UserError:
        return UserError(f"{path}: cannot be read as JSON ({error}).{advice}")

    with reraise_as(told, (OSError, ValueError)):
        return read_json(path)


def read_json(path: Path) -> Any:
    """The content of a JSON file in UTF-8, with or without a byte order mark (OSError: the file cannot be
    read; ValueError: the file is not JSON, or nested too deeply)."""
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except RecursionError:
        raise ValueError("nested too deeply") from None


# More than the logs and notes of a run need.
_ROOM_BYTES = 2**20


def check_writable(folders: Iterable[Path], advice: str = "Results go there; make it writable") -> None:
    """Check that a file of 1 MiB can be written in each folder, or in its nearest parent that exists (UserError, with the advice)."""
    existing = (
        next(each for each in (folder, *folder.absolute().parents) if each.is_dir()) for folder in folders
    )
    for folder in dict.fromkeys(existing):
        try:
            with tempfile.NamedTemporaryFile(prefix=".egosplat-", dir=folder) as probe:
                probe.write(bytes(_ROOM_BYTES))
                probe.flush()
        except OSError as error:
            told = MAKE_ROOM if error.errno in NO_ROOM else advice
            raise UserError(f"{folder.absolute()}: {error.strerror}. {told}") from None


def check_output(path: Path, own_name: str, *, overwrite: bool) -> None:
    """Check, before any work is done, that a command may write a file (UserError); nothing is left behind.

    A file that is there is replaced if it has the command's own name, or with the flag ``--overwrite``. Every other name
    must have the suffix of ``own_name``, too.
    """
    suffix = Path(own_name).suffix
    if path.suffix.lower() != suffix:
        raise UserError(f"{path}: the file is a {suffix}; give --output a name that ends so")
    # A link is not followed: its target may be anyone's file.
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise UserError(f"{path}: is there and no regular file; give another --output")
    if path.exists() and path.name != own_name and not overwrite:
        raise UserError(f"{path}: is there already; give another --output, or --overwrite to replace it")
    _check_parent(path)


def check_new_folder(path: Path) -> None:
    """Check, before any work is done, that a command may make a folder (UserError), where not even a link may be."""
    if os.path.lexists(path):
        raise UserError(f"{path}: is there already; give another --output, or remove it first")
    _check_parent(path)


def _check_parent(path: Path) -> None:
    nearest = next(each for each in path.absolute().parents if each.exists())
    if not nearest.is_dir():
        raise UserError(f"{path}: {nearest} is no folder; give another --output")
    check_writable([path.parent], "Give another --output, or make it writable")


def _begin(path: Path) -> Path:
    if path.name in ("", ".."):
        raise UserError(f"{path}: is no name of a file or folder; give another --output")
    # A pipe or a device is of another program; a link is replaced itself.
    if path.exists() and not (path.is_file() or path.is_dir() or path.is_symlink()):
        raise UserError(f"{path}: is there and no regular file or folder; give another --output")
    path.parent.mkdir(parents=True, exist_ok=True)
    _sweep(path.parent.glob(f".{path.name}.????????.tmp"))
    return _beside(path)


def _beside(path: Path) -> Path:
    # Next to the final path, because a rename works within one file system only. A killed writer leaves this hidden
    # name, which the next writer of the same path removes.
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.tmp")


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Add ``path`` to an error about a full disk: the operating system names no file when a write fails."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            error.filename = str(path)
        raise


@contextlib.contextmanager
def _locked(scratch: Path, *, needed: bool = False, wait: bool = False) -> Iterator[None]:
    """Hold a lock on a file or directory. It ends with the process, so a lock that can be taken marks a killed writer. None is held
    where the file system has no locks, unless it is ``needed`` (OSError)."""
    # NFS locks a file only if it is open for writing.
    handle = os.open(scratch, os.O_RDONLY if scratch.is_dir() else os.O_RDWR)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if needed or isinstance(error, BlockingIOError):
                raise
        yield
    finally:
        os.close(handle)


def _sweep(scratch: Iterable[Path]) -> None:
    """Remove those scratch files and directories whose writers were killed."""
    for left in scratch:
        # A lock that cannot be taken is held by a writer that still runs.
        with contextlib.suppress(OSError), _locked(left, needed=True):
            shutil.rmtree(left) if left.is_dir() else left.unlink()


def _sync(root: Path) -> None:
    # Files, then directories: otherwise a rename may reach the disk before the bytes, and a power failure leaves an empty file.
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
    """Rename into place. A symbolic link is replaced itself; its target stays."""
    if not os.path.lexists(path):
        os.rename(scratch, path)
        return
    # A directory cannot be replaced by a rename. It is moved away first, so ``path`` is complete or absent at any moment.
    aside = _beside(path)
    os.rename(path, aside)
    os.rename(scratch, path)
    shutil.rmtree(aside) if aside.is_dir() and not aside.is_symlink() else aside.unlink()
