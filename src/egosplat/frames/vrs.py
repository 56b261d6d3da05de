"""Check that a VRS file is complete.

projectaria-tools drops records beyond the end of a truncated file and continues with a shorter recording.
``check_complete`` walks through the records; the library's log tells of files truncated exactly at a record's end.
"""

import mmap
import struct
from pathlib import Path

from egosplat.errors import UserError

# Two magic numbers, file id, sizes of file and record header, offsets of index, description and first record.
_HEADER = struct.Struct("<IIQIIqqq")
_MAGIC = (0x69736956, 0x65526E6F)
_HEADER_SIZE = 80


def check_complete(path: Path) -> None:
    """Walk through the records of a VRS file; UserError if it is missing, no VRS file, truncated or damaged."""
    if not path.is_file():
        raise UserError(f"{path}: not found. Check the path, or download this file of the recording.")
    size = path.stat().st_size
    if size < _HEADER_SIZE:
        raise UserError(f"{path}: only {size} bytes, not a VRS file. Download it again.")
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        *magic, _, header_size, record_header_size, _, _, first_record = _HEADER.unpack_from(data)
        if tuple(magic) != _MAGIC:
            raise UserError(f"{path}: not a VRS file. Download it again.")
        position = first_record or header_size
        if position < _HEADER_SIZE:
            raise UserError(f"{path}: its header is damaged. Download it again.")
        # Each record's header begins with the record's size, header included.
        while position + 4 <= size:
            record_size = int.from_bytes(data[position : position + 4], "little")
            if record_size < max(record_header_size, 1):
                raise UserError(f"{path}: damaged at byte {position}. Download it again.")
            position += record_size
    if position != size:
        raise UserError(f"{path}: truncated: {size} bytes, but its records go on. Download it again.")
