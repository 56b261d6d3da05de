"""Layouts of the fixed fields in a VRS file's records (``DataLayout.h`` of facebookresearch/vrs).

A layout is stored in the file as JSON text. Readers look up its fields by name.
"""

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass

_STRUCT_CODES = {"uint32_t": "I", "uint64_t": "Q", "int64_t": "q", "double": "d"}


@dataclass(frozen=True)
class DataLayout:
    """Fields of a record: numbers first (name, C type), then strings of any length."""

    numbers: tuple[tuple[str, str], ...]
    strings: tuple[str, ...] = ()

    @property
    def _struct(self) -> struct.Struct:
        return struct.Struct("<" + "".join(_STRUCT_CODES[kind] for _, kind in self.numbers))

    @property
    def fixed_size(self) -> int:
        """Size of the numbers in bytes."""
        return self._struct.size

    def describe(self) -> str:
        """The JSON text that gives each field's offset."""
        pieces: list[dict[str, str | int]] = []
        offset = 0
        for name, kind in self.numbers:
            pieces.append({"name": name, "type": f"DataPieceValue<{kind}>", "offset": offset})
            offset += struct.calcsize("<" + _STRUCT_CODES[kind])
        pieces += [
            {"name": name, "type": "DataPieceString", "index": index}
            for index, name in enumerate(self.strings)
        ]
        return json.dumps({"data_layout": pieces})

    def pack(self, values: Mapping[str, float | str]) -> bytes:
        """The fields as bytes; a field without a value is NaN, 0 or the empty string.

        Raises:
            ValueError: a value has no field.
        """
        unknown = set(values) - {name for name, _ in self.numbers} - set(self.strings)
        if unknown:
            raise ValueError(f"the layout has no field {sorted(unknown)}")
        empty = {"double": math.nan}
        packed = self._struct.pack(*(values.get(name, empty.get(kind, 0)) for name, kind in self.numbers))
        texts = [str(values.get(name, "")).encode() for name in self.strings]
        offsets = [sum(map(len, texts[:index])) for index in range(len(texts))]
        table = b"".join(struct.pack("<II", at, len(text)) for at, text in zip(offsets, texts, strict=True))
        return packed + table + b"".join(texts)


def _fields(text: str) -> tuple[tuple[str, str], ...]:
    return tuple((name, kind) for kind, name in map(str.split, text.split(",")))


# Names and order are those of Aria's image streams.
CONFIGURATION = DataLayout(
    _fields("""
    uint32_t camera_id, double nominal_rate, uint32_t image_width, uint32_t image_height, uint32_t
    image_stride, uint32_t image_pixel_format, double exposure_duration.min, double exposure_duration.max,
    double gain.min, double gain.max, double gamma_factor"""),
    (
        *("device_type", "device_version", "device_serial", "sensor_model", "sensor_serial"),
        *("factory_calibration", "online_calibration", "description"),
    ),
)
IMAGE_DATA = DataLayout(
    _fields("""
    uint64_t group_id, uint64_t group_mask, uint64_t frame_number, uint32_t frame_tag, double
    exposure_duration_s, double gain, int64_t capture_timestamp_ns, int64_t
    capture_timestamp_in_processing_clock_domain_ns, int64_t arrival_timestamp_ns, int64_t
    processing_start_timestamp_ns, double temperature_deg_c""")
)
