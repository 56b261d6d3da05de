"""Write VRS files, containers of sensor records; here image streams, written in one pass.

Format (``FileFormat.h`` and ``IndexRecord.h`` of facebookresearch/vrs), little-endian::

    file header (80 bytes; holds the offsets of the description and of the index)
    description record    streams, the layouts of their records, and the file's tags
    configuration record   image size, pixel format, ...
    data records          in order of time: fixed fields, then the image
    index record          time, size, type and stream of every record

Every record begins with a 32-byte header that holds its own size and that of the previous record.
"""

import contextlib
import hashlib
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

from numcodecs import zstd  # pyright: ignore[reportAttributeAccessIssue] (compiled)

from egosplat.files import atomic_file
from egosplat_apartments.adt_format.vrs_layout import CONFIGURATION, IMAGE_DATA

_FILE_HEADER = struct.Struct("<8sQIIqqqQQQ4s4s")
_RECORD_HEADER = struct.Struct("<IIiIdHBBI")
_STREAM_ID = struct.Struct("<iH")
_INDEX_ENTRY = struct.Struct("<dIBiH")
_COUNT = struct.Struct("<I")

_INDEX_TYPE, _DESCRIPTION_TYPE = 1, 2
_CONFIGURATION, _DATA = 2, 3
# Version of the description record, of an index record that follows the data, and of the layouts below.
_STRUCTURE_VERSION = 2
_NO_COMPRESSION, _ZSTD = 0, 2
_ZSTD_LEVEL = 3
_BEFORE_ALL = 5e-324
_AFTER_ALL = 1.7976931348623157e308


@dataclass(frozen=True)
class ImageStream:
    """One camera's stream in the file.

    Attributes:
        type_id, instance_id: number of the stream; "214-1" is type 214, instance 1.
        name: name of the recordable; flavor: its variant.
        encoding: ``jpg``, or ``raw`` for rows of pixels as the configuration says.
        compressed: whether whole records are compressed with zstd (lossless).
        configuration: values of ``CONFIGURATION``.
    """

    type_id: int
    instance_id: int
    name: str
    flavor: str
    encoding: Literal["jpg", "raw"]
    compressed: bool
    configuration: Mapping[str, float | str]

    @property
    def tags(self) -> dict[str, str]:
        """The stream's tags in the description record."""
        version = _STRUCTURE_VERSION
        serial = hashlib.sha256(f"{self.type_id}-{self.instance_id} {self.name}".encode()).hexdigest()[:16]
        return {
            f"DL:Configuration:{version}:0": CONFIGURATION.describe(),
            f"DL:Data:{version}:0": IMAGE_DATA.describe(),
            f"RF:Configuration:{version}": "data_layout",
            f"RF:Data:{version}": f"data_layout/size={IMAGE_DATA.fixed_size}+image/{self.encoding}",
            "VRS_Original_Recordable_Name": self.name,
            "VRS_Recordable_Flavor": self.flavor,
            "VRS_Serial_Number": serial,
        }


@contextlib.contextmanager
def create_vrs(path: Path, tags: Mapping[str, str], stream: ImageStream) -> Iterator["VrsWriter"]:
    """Write a VRS file; it appears at ``path`` only if the block ends without error."""
    with atomic_file(path) as scratch, scratch.open("wb") as file:
        writer = VrsWriter(file, tags, stream)
        yield writer
        writer.finish()


class VrsWriter:
    """Writes the records of a VRS file with one stream; made by ``create_vrs``."""

    def __init__(self, file: BinaryIO, tags: Mapping[str, str], stream: ImageStream) -> None:
        self._file = file
        self._stream = stream
        self._id = (stream.type_id, stream.instance_id)
        self._previous_size = 0
        self._index: list[bytes] = []
        self._last_ns: int | None = None
        # The number of streams; the stream's id, user tags (none) and tags; the file's tags.
        streams = _COUNT.pack(1) + _STREAM_ID.pack(*self._id)
        description = streams + _pack_tags({}) + _pack_tags(stream.tags) + _pack_tags(tags)
        # An id from the content, not from the clock, so that the same recording gives the same bytes.
        self._creation_id = int.from_bytes(hashlib.sha256(description).digest()[:8], "little")
        file.write(bytes(_FILE_HEADER.size))  # filled in at the end, when the index has its place
        self._append((_DESCRIPTION_TYPE, 0), _DATA, _AFTER_ALL, description)
        self._first_record = file.tell()
        self._append_indexed(_CONFIGURATION, _BEFORE_ALL, CONFIGURATION.pack(stream.configuration))

    def write_image(
        self, image: bytes, *, timestamp_ns: int, frame_number: int, exposure_s: float, gain: float
    ) -> None:
        """Append one image, encoded as the stream says.

        Raises:
            ValueError: its timestamp is lower than the previous one's.
        """
        if self._last_ns is not None and timestamp_ns < self._last_ns:
            raise ValueError(f"record of {timestamp_ns} ns after {self._last_ns} ns: not in order of time")
        self._last_ns = timestamp_ns
        times = ("capture_timestamp_ns", "arrival_timestamp_ns", "processing_start_timestamp_ns")
        fields = IMAGE_DATA.pack(
            {
                "frame_number": frame_number,
                "exposure_duration_s": exposure_s,
                "gain": gain,
                "capture_timestamp_in_processing_clock_domain_ns": -1,
                **dict.fromkeys(times, timestamp_ns),
            }
        )
        self._append_indexed(_DATA, timestamp_ns * 1e-9, fields + image)

    def finish(self) -> None:
        """Write the index, then the file header that points to it."""
        index_offset = self._file.tell()
        index = [_COUNT.pack(1), _STREAM_ID.pack(*self._id), _COUNT.pack(len(self._index)), *self._index]
        self._append((_INDEX_TYPE, 0), _DATA, _AFTER_ALL, b"".join(index))
        self._file.seek(0)
        self._file.write(
            _FILE_HEADER.pack(
                b"VisionRe",
                self._creation_id,
                _FILE_HEADER.size,
                _RECORD_HEADER.size,
                index_offset,
                _FILE_HEADER.size,  # the description follows the header
                self._first_record,
                *(0, 0, 0),
                b"cord",
                b"VRS1",
            )
        )

    def _append_indexed(self, kind: int, time_s: float, payload: bytes) -> None:
        size = self._append(self._id, kind, time_s, payload, self._stream.compressed and kind == _DATA)
        self._index.append(_INDEX_ENTRY.pack(time_s, size, kind, *self._id))

    def _append(
        self, stream_id: tuple[int, int], kind: int, time_s: float, payload: bytes, compress: bool = False
    ) -> int:
        """Append a record and return its size in the file."""
        uncompressed_size = len(payload) if compress else 0
        body = zstd.compress(payload, _ZSTD_LEVEL) if compress else payload
        size = _RECORD_HEADER.size + len(body)
        type_id, instance_id = stream_id
        compression = _ZSTD if compress else _NO_COMPRESSION
        sizes = (size, self._previous_size)
        what = (type_id, _STRUCTURE_VERSION, time_s, instance_id, kind)
        self._file.write(_RECORD_HEADER.pack(*sizes, *what, compression, uncompressed_size))
        self._file.write(body)
        self._previous_size = size
        return size


def _pack_tags(tags: Mapping[str, str]) -> bytes:
    texts = [text.encode() for name in sorted(tags) for text in (name, tags[name])]
    return _COUNT.pack(len(tags)) + b"".join(_COUNT.pack(len(text)) + text for text in texts)
