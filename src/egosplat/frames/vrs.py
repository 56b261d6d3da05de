"""Check that a VRS file is complete.

projectaria-tools drops records beyond the end of a truncated file and continues with a shorter recording.
``check_complete`` walks through the records; the library's log tells of files truncated exactly at a record's end.
"""

import mmap
import struct
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from egosplat.errors import UserError
from egosplat.frames.native_log import captured_log, log_messages

Provider = TypeVar("Provider")

# Two magic numbers, file id, sizes of file and record header, offsets of index, description and first record.
_HEADER = struct.Struct("<IIQIIqqq")
_MAGIC = (0x69736956, 0x65526E6F)
_HEADER_SIZE = 80
_DROPPED_RECORDS = "beyond the end of the file"


def check_complete(path: Path) -> None:
    """Walk through the records of a VRS file; UserError if it is missing, no VRS file, truncated or damaged."""
    if not path.is_file():
        raise UserError(f"{path}: not found. Check the path, or download this file of the recording.")
    size = path.stat().st_size
    if size < _HEADER_SIZE:
        raise UserError(f"{path}: only {size} bytes, not a VRS file. Download it again.")
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        magic_1, magic_2, _, header_size, record_header_size, _, _, first_record = _HEADER.unpack_from(data)
        if (magic_1, magic_2) != _MAGIC:
            raise UserError(f"{path}: not a VRS file. Download it again.")
        _walk_records(path, data, first_record or header_size, record_header_size)


def _walk_records(path: Path, data: mmap.mmap, position: int, header_size: int) -> None:
    size = len(data)
    if not _HEADER_SIZE <= position:
        raise UserError(f"{path}: its header is damaged. Download it again.")
    # Each record's header begins with the record's size, header included.
    while position + 4 <= size:
        record_size = int.from_bytes(data[position : position + 4], "little")
        if record_size < max(header_size, 1):
            raise UserError(f"{path}: damaged at byte {position}. Download it again.")
        position += record_size
    if position != size:
        raise UserError(f"{path}: truncated: {size} bytes, but its records go on. Download it again.")


def open_checked(path: Path, opened: Callable[[], Provider | None]) -> Provider:
    """Open a VRS file by a function of projectaria-tools; UserError if it is missing, damaged or truncated."""
    check_complete(path)
    try:
        with captured_log() as messages:
            provider = opened()
    except RuntimeError as error:
        raise UserError(f"{path}: cannot be read ({error}). Download it again.") from error
    if provider is None:
        raise UserError(f"{path}: cannot be read ({'; '.join(messages)}). Download it again.")
    if dropped := [message for message in messages if _DROPPED_RECORDS in message]:
        raise UserError(f"{path}: truncated ({dropped[0]}). Download it again.")
    log_messages(messages, path)
    return provider
