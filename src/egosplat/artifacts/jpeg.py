"""Zarr's codec of pictures as JPEG, for recordings of hours: a fifth of the bytes of their exact pixels."""

from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
from zarr.abc.codec import ArrayBytesCodec
from zarr.core.array_spec import ArraySpec
from zarr.core.buffer import Buffer, NDBuffer
from zarr.registry import register_codec


@dataclass(frozen=True)
class Jpeg(ArrayBytesCodec):
    """(1, H, W, 3) uint8 sRGB chunks as JPEG, with colors at full size. ``quality`` is 1 to 100."""

    is_fixed_size = False
    quality: int = 95

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The codec of an array's metadata."""
        return cls(**data["configuration"])

    def to_dict(self) -> dict[str, Any]:
        """The codec as metadata."""
        return {"name": "egosplat.jpeg", "configuration": {"quality": self.quality}}

    async def _encode_single(self, chunk_array: NDBuffer, chunk_spec: ArraySpec) -> Buffer:
        rates = [cv2.IMWRITE_JPEG_QUALITY, self.quality]
        rates += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        _, encoded = cv2.imencode(".jpg", chunk_array.as_numpy_array()[0, ..., ::-1], rates)
        return chunk_spec.prototype.buffer.from_bytes(encoded.tobytes())

    async def _decode_single(self, chunk_data: Buffer, chunk_spec: ArraySpec) -> NDBuffer:
        # None for bytes that are no JPEG file.
        picture = cv2.imdecode(chunk_data.as_numpy_array(), cv2.IMREAD_COLOR)
        if picture is None or (1, *picture.shape) != chunk_spec.shape:
            raise ValueError("it is no JPEG of its picture")
        return chunk_spec.prototype.nd_buffer.from_numpy_array(np.ascontiguousarray(picture[None, ..., ::-1]))


register_codec("egosplat.jpeg", Jpeg)
