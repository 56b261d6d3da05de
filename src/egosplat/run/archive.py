"""Unpack an archive of a recording."""

import hashlib
import shutil
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from egosplat.errors import MAKE_ROOM, UserError, reraise_as
from egosplat.files import atomic_directory

# Of a damaged archive, an encrypted one, and one with another compression.
_FAULTS = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError)


def unpack(archive: Path, beside: Path) -> Path:
    """Unpack a .zip, unless this has been done.

    Args:
        beside: the folder that is made has this name, followed by a digest of what the archive holds.

    Raises:
        UserError: it is no .zip, is damaged or encrypted, names files outside of itself, or the disk has no room.
    """
    with (
        reraise_as(
            lambda error: UserError(
                f"{archive}: cannot be unpacked ({error}); copy it again, or pack it anew"
            ),
            _FAULTS,
        ),
        zipfile.ZipFile(archive) as opened,
    ):
        members = opened.infolist()
        folder = beside.with_name(f"{beside.name}-{_digest(members)}")
        if not folder.is_dir():
            _check(archive, members, beside)
            with atomic_directory(folder) as scratch:
                opened.extractall(scratch)
    return folder


def _digest(members: list[zipfile.ZipInfo]) -> str:
    told = sorted((one.filename, one.file_size, one.CRC) for one in members)
    return hashlib.sha256(repr(told).encode()).hexdigest()[:8]


def _check(archive: Path, members: list[zipfile.ZipInfo], beside: Path) -> None:
    for one in members:
        path = PurePosixPath(one.filename.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts:
            raise UserError(f"{archive}: names the file {one.filename[:80]} outside of itself; pack it anew")
    existing = next(each for each in beside.absolute().parents if each.is_dir())
    needed, free = sum(one.file_size for one in members), shutil.disk_usage(existing).free
    if needed > free:
        raise UserError(
            f"{archive}: holds {needed / 1e6:,.0f} MB, and {existing} has room for {free / 1e6:,.0f}. {MAKE_ROOM}"
        )
