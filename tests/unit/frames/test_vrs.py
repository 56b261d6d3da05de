"""Truncated and damaged VRS files are rejected, on a file of record headers only."""

import struct

import pytest

from egosplat.errors import UserError
from egosplat.frames.vrs import check_complete


def vrs_file(path, sizes=(100, 64, 32), first_record=0):
    """A VRS header and records of the given sizes."""
    header = struct.pack("<IIQIIqqq", 0x69736956, 0x65526E6F, 1, 80, 32, 0, 80, first_record).ljust(80, b"\0")
    path.write_bytes(header + b"".join(struct.pack("<I", size).ljust(size, b"\1") for size in sizes))
    return path


@pytest.mark.parametrize("lost", [1, 31, 32, 33, 90])
def test_a_truncated_file_is_named(tmp_path, lost):
    path = vrs_file(tmp_path / "video.vrs")
    content = path.read_bytes()
    # A loss at a record's very end leaves a file that ends properly: only the index could tell.
    path.write_bytes(content[:-lost])
    if lost == 32:
        check_complete(path)
    else:
        with pytest.raises(UserError, match="video.vrs.*truncated"):
            check_complete(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: b"", "only 0 bytes"),
        (lambda content: content[:79], "only 79 bytes"),
        (lambda content: b"text" * 100, "not a VRS file"),
        (lambda content: content[:80] + bytes(196), "damaged at byte 80"),
        (lambda content: content[:40] + b"\xff" * 8 + content[48:], "header is damaged"),
    ],
)
def test_a_file_that_is_not_vrs_is_named(tmp_path, change, message):
    path = vrs_file(tmp_path / "video.vrs")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(UserError, match=f"video.vrs: .*{message}"):
        check_complete(path)
