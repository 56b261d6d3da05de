"""Write artifacts, whole or not at all (``egosplat.files``)."""

import contextlib
import json
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from egosplat.artifacts.integrity import ArtifactError, check_replaceable, digest_of, seal
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.schema import Schema, check_shape, sizes_of
from egosplat.artifacts.shards import CHUNKS_IN_SHARD, EXACT, Shards
from egosplat.files import atomic_directory


class Writer:
    """The arrays of an artifact that is being written; from ``create``."""

    def __init__(self, path: Path, scratch: Path, schema: Schema) -> None:
        self._path, self._scratch, self._schema = path, scratch, schema
        # Mode "w" would replace the folder and lose its lock.
        self._group = zarr.open_group(scratch, mode="a")
        self._sizes: dict[str, int] = {}
        self._arrays: dict[str, Shards] = {}
        self._highest: dict[str, int] = {}
        self.facts: dict[str, Any] = {}
        """Small results that are not arrays; plain JSON values."""

    def put(self, name: str, values: NDArray[Any]) -> None:
        """Store a whole array; ValueError for another shape or element type, ArtifactError if a number is not allowed."""
        self.allocate(name, values.shape)
        self._store(name, 0, values)

    def allocate(self, name: str, shape: tuple[int, ...], codecs: dict[str, Any] = EXACT) -> None:
        """Create an array whose rows ``put_row`` writes, if each is a chunk by its schema; ``AS_JPEG`` is for pictures."""
        declared = self._schema.fields[name]
        check_shape(declared, shape, self._sizes, name)
        rows, *rest = (max(1, size) for size in shape)
        in_chunk = min(declared.by_row, rows) or rows
        in_shard = min(CHUNKS_IN_SHARD, -(-rows // in_chunk))
        array = self._group.create_array(
            name,
            shape=shape,
            dtype=declared.dtype,
            chunks=(in_chunk, *rest),
            shards=(in_chunk * in_shard, *rest),
            **codecs,
            # All files of an array lie in one folder.
            chunk_key_encoding={"name": "default", "separator": "."},
            dimension_names=[dim if isinstance(dim, str) else None for dim in declared.dims],
            # All-zero chunks are stored too, so that a missing file always means damage.
            config={"write_empty_chunks": True},
            attributes={"unit": declared.unit, "about": declared.about},
        )
        self._arrays[name] = Shards(self._scratch / name, array, in_shard, codecs)

    def put_row(self, name: str, index: int, values: NDArray[Any]) -> None:
        """Store row ``index`` of an allocated array, once; shape and element type must match exactly. Raises as ``put``."""
        if self._schema.fields[name].by_row != 1:
            raise ValueError(f"{name}: is not written by row")
        self._store(name, index, values[None])

    def finish(self) -> None:
        """Check that every declared array and row was written, and indices against the sizes that are known now."""
        fields = self._schema.fields.items()
        if missing := sorted({name for name, field in fields if not field.optional} - set(self._arrays)):
            raise ValueError(f"artifact {self._schema.name}: never written: {', '.join(missing)}")
        for name, shards in self._arrays.items():
            if missing := shards.finish():
                raise ValueError(f"artifact {self._schema.name}: {name} lacks {missing} rows")
        sizes = sizes_of(self._sizes, self.facts)
        for name, highest in self._highest.items():
            self._raise(name, self._schema.fields[name].values.find_fault(np.array(highest), sizes))

    def _store(self, name: str, first: int, values: NDArray[Any]) -> None:
        """Check and store rows from ``first`` on."""
        declared, given = self._arrays[name].array, (values.dtype, values.shape[1:])
        if given != (declared.dtype, declared.shape[1:]):
            raise ValueError(f"{name}: {given} given, {declared.dtype} {declared.shape[1:]} declared")
        allowed = self._schema.fields[name].values
        self._raise(name, allowed.find_fault(values, {}))
        # Labels are written before the instances are counted.
        if allowed.below is not None and values.size:
            self._highest[name] = max(int(values.max()), self._highest.get(name, -1))
        self._arrays[name].put(first, values)

    def _raise(self, name: str, fault: str) -> None:
        if fault:
            advice = f"An input may be broken: egosplat check {shlex.quote(str(self._path.parent))}"
            raise ArtifactError(f"{self._path}: is not written: array {name!r} {fault}. {advice}")


@contextlib.contextmanager
def create(path: Path, schema: Schema, provenance: Provenance) -> Iterator[Writer]:
    """Write an artifact, which appears at ``path``, with time and memory, when the block ends without error, in place of one of
    the same kind (ArtifactError: something else is there, or the schema does not allow a number)."""
    check_replaceable(path, schema)
    with atomic_directory(path) as scratch:
        writer = Writer(path, scratch, schema)
        yield writer
        writer.finish()
        attributes = {
            "schema": schema.name,
            "format_version": schema.version,
            "digest": digest_of(scratch),
            "provenance": provenance.record(),
            "facts": writer.facts,
        }
        # A round trip through JSON, so that the seal covers exactly what a reader gets.
        attributes = json.loads(json.dumps(attributes, allow_nan=False))
        attributes["seal"] = seal(attributes)
        zarr.open_group(scratch, mode="a").attrs.put({"egosplat": attributes})
