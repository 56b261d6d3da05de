"""Write arrays in shards: files that hold many chunks each, of Zarr's sharding codec."""

from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec

from egosplat.artifacts.jpeg import Jpeg

# An hour of frames is hundreds of files, not a hundred thousand. A file of pictures of 1408 px has a quarter of a gigabyte.
CHUNKS_IN_SHARD = 64

# The checksum is over the compressed bytes, so damage is found before they are unpacked.
EXACT: dict[str, Any] = {"compressors": (ZstdCodec(level=3), Crc32cCodec())}
AS_JPEG: dict[str, Any] = {"serializer": Jpeg(), "compressors": Crc32cCodec()}


class Shards:
    """The files of an array, written chunk by chunk. Zarr would hold a shard, or write it again for each."""

    def __init__(self, folder: Path, array: zarr.Array, chunks_in_shard: int, codecs: dict[str, Any]) -> None:
        self._folder, self.array, self._codecs = folder, array, codecs
        self._chunks = -(-array.shape[0] // array.chunks[0]) if array.size else 0
        # First byte and number of bytes of each chunk in its file, -1 where it is not put.
        self._index = np.full((-(-self._chunks // chunks_in_shard), chunks_in_shard, 2), -1, np.int64)

    def put(self, first: int, values: NDArray[Any]) -> None:
        """Write the chunks of rows from ``first`` on; only the array's last chunk may be short."""
        rows = self.array.chunks[0]
        for start in range(0, len(values) if values.size else 0, rows):
            shard, place = divmod((first + start) // rows, self._index.shape[1])
            chunk = values[start : start + rows]
            self._index[shard, place] = self._add(shard, chunk, self.array.chunks, self._codecs)

    def finish(self) -> int:
        """Write the index of each file at its end; returns the number of chunks that were not put."""
        for shard, index in enumerate(self._index):
            self._add(shard, index, index.shape, {"compressors": Crc32cCodec()})
        return int((self._index.reshape(-1, 2)[: self._chunks, 0] < 0).sum())

    def _add(
        self, shard: int, values: NDArray[Any], shape: tuple[int, ...], codecs: dict[str, Any]
    ) -> tuple[int, int]:
        """Write values, and zeros up to a shape, as Zarr stores a chunk; returns its first byte and number of bytes."""
        store: dict[str, Any] = {}
        kind = {"dtype": values.dtype, "config": {"write_empty_chunks": True}}
        chunk = zarr.create_array(store, shape=shape, chunks=shape, **kind, **codecs)
        chunk[: len(values)] = values
        encoded = store[chunk.metadata.encode_chunk_key((0,) * chunk.ndim)].to_bytes()
        name = self.array.metadata.encode_chunk_key((shard, *[0] * (self.array.ndim - 1)))
        with (self._folder / name).open("ab") as file:
            return file.tell(), file.write(encoded)
