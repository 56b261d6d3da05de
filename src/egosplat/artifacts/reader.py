"""Read artifacts with checks.

Opening checks schema, version, seal and completeness. Reading checks the CRC32C of each chunk, and its numbers by the
schema. ``verify`` checks every byte and number.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from egosplat.artifacts.integrity import ArtifactError, absent, damaged, digest_of, rebuild_command, seal
from egosplat.artifacts.schema import Field, Schema, check_shape, sizes_of
from egosplat.errors import reraise_as


class _Attributes(dict[str, Any]):
    """Attributes of an artifact; one that is missing, as in an artifact of an older egosplat, is an ``ArtifactError``."""

    def __init__(self, values: Mapping[str, Any], path: Path) -> None:
        self.path = path
        super().__init__(
            (key, _Attributes(value, path) if isinstance(value, dict) else value)
            for key, value in values.items()
        )

    def __missing__(self, key: str) -> Any:
        raise damaged(self.path, f"its attributes lack {key!r}")


class Artifact:
    """A checked, read-only artifact; made by ``open_artifact`` or ``open_any``."""

    def __init__(
        self,
        path: Path,
        schema: Schema,
        group: zarr.Group,
        attributes: dict[str, Any],
        axes: Mapping[str, int],
    ) -> None:
        self.path = path
        self.schema = schema
        self._group = group
        self._attributes = attributes
        self._sizes = sizes_of(axes, self.facts)

    @property
    def facts(self) -> dict[str, Any]:
        """Small results that are not arrays."""
        return self._attributes["facts"]

    @property
    def digest(self) -> str:
        """SHA-256 over the stored arrays."""
        return self._attributes["digest"]

    @property
    def provenance(self) -> dict[str, Any]:
        """Stage, options, inputs, versions, origin, time and memory of its making."""
        return self._attributes["provenance"]

    @property
    def origin(self) -> str:
        """``real`` or ``synthetic``."""
        return self.provenance["origin"]

    @property
    def arrays(self) -> list[str]:
        """Names of the arrays of its schema that it holds; it may lack optional ones."""
        return [name for name in self.schema.fields if name in self._group]

    def has(self, name: str) -> bool:
        """Whether it holds an array that its schema calls optional."""
        return name in self._group

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of an array, without reading it."""
        return self._array(name).shape

    def _array(self, name: str) -> zarr.Array:
        array = self._group[name]
        assert isinstance(array, zarr.Array)  # checked when it was opened
        return array

    def read(self, name: str) -> NDArray[Any]:
        """Read a whole array; ArtifactError if a chunk's checksum differs, or the schema does not allow a number."""
        array = self._array(name)
        if array.nchunks == 1:
            return self._checked(array, name, slice(0, array.shape[0]))
        values = np.empty(array.shape, array.dtype)
        for start, chunk in self._chunks(name):
            values[start : start + len(chunk)] = chunk
        return values

    def check(self, name: str) -> None:
        """Read an array chunk by chunk and keep nothing. Raises as ``read``."""
        for _ in self._chunks(name):
            pass

    def row(self, name: str, index: int) -> NDArray[Any]:
        """Read one index of the first axis. Raises as ``read``."""
        return self._checked(self._array(name), name, index)

    def _chunks(self, name: str) -> Iterator[tuple[int, NDArray[Any]]]:
        """First row and values of each chunk, so that an error names the damaged one."""
        array = self._array(name)
        # A matrix or vector of fixed size has one chunk.
        for start in range(0, array.shape[0] if array.size else 0, array.chunks[0]):
            yield start, self._checked(array, name, slice(start, start + array.chunks[0]))

    def _checked(self, array: zarr.Array, name: str, selection: int | slice) -> NDArray[Any]:
        first = selection.start if isinstance(selection, slice) else selection
        where = f"array {name!r}" + ("" if array.nchunks == 1 else f", chunk {first // array.chunks[0]}")

        def tell(error: Exception) -> ArtifactError:
            return damaged(self.path, f"{where} cannot be read ({_reason(error)})")

        with reraise_as(tell, (ValueError, RuntimeError, OSError, KeyError)):
            values = np.asarray(array[selection])
        if fault := self.schema.fields[name].values.find_fault(values, self._sizes):
            raise damaged(self.path, f"{where} {fault}")
        return values


def _reason(error: Exception) -> str:
    """A library's error in a few words."""
    # The bytes of a checksum do not help a user.
    text = str(error).partition("\n")[0]
    return "its checksum does not match" if "checksum" in text else text or type(error).__name__


def open_artifact(path: Path, schema: Schema) -> Artifact:
    """Open an artifact and check all that can be checked without reading its arrays.

    Raises:
        ArtifactError: it is absent, of another kind or version, or damaged; the message says how to rebuild it.
        OSError, MemoryError, RuntimeError: a system error, see ``egosplat.errors``.
    """
    return _checked_artifact(path, schema, *_open(path))


def _checked_artifact(path: Path, schema: Schema, group: zarr.Group, attributes: dict[str, Any]) -> Artifact:
    found = attributes.get("schema")
    if found != schema.name:
        raise ArtifactError(f"{path}: holds {found!r}, not {schema.name!r}. Give the {schema.name} artifact.")
    version = attributes["format_version"]
    if version != schema.version:
        newer = isinstance(version, int) and version > schema.version
        hint = "Update egosplat" if newer else f"Rebuild it: {rebuild_command(path)}"
        raise ArtifactError(
            f"{path}: has format version {version}, this is version {schema.version}. {hint}."
        )
    axes = _check_arrays(path, schema, group)
    return Artifact(path, schema, group, attributes, axes)


def open_any(path: Path, schemas: Mapping[str, Schema]) -> Artifact:
    """Open an artifact of any kind in ``schemas``; ArtifactError as ``open_artifact``, or for another kind."""
    group, attributes = _open(path)
    schema = schemas.get(attributes.get("schema", ""))
    if schema is None:
        raise ArtifactError(
            f"{path}: holds {attributes.get('schema')!r}, a kind that this egosplat does not know."
        )
    return _checked_artifact(path, schema, group, attributes)


def verify(path: Path, schemas: Mapping[str, Schema]) -> Artifact:
    """Open an artifact of any kind in ``schemas``; check every stored byte against its digest, and every number.

    Raises:
        ArtifactError: as ``open_any``, a file was changed, added or removed, or the schema does not allow a number.
    """
    artifact = open_any(path, schemas)
    changed = digest_of(path) != artifact.digest
    for name in artifact.arrays:  # raises with the name of the damaged chunk
        if changed or artifact.schema.fields[name].values.limits(artifact.schema.fields[name].dtype):
            artifact.check(name)
    if changed:
        raise damaged(path, "its files are not those that were written (digest differs)")
    return artifact


def recorded_digest(path: Path) -> str:
    """The digest in an artifact's attributes, without reading an array; ArtifactError if they cannot be trusted."""
    return _open(path)[1]["digest"]


def _open(path: Path) -> tuple[zarr.Group, dict[str, Any]]:
    if not path.exists():
        raise absent(path)

    def tell(error: Exception) -> ArtifactError:
        if isinstance(error, KeyError):
            return ArtifactError(
                f"{path}: is a Zarr group that egosplat did not write. Give an artifact of egosplat"
            )
        return damaged(path, f"is no readable Zarr group ({type(error).__name__})")

    with reraise_as(tell):
        group = zarr.open_group(path, mode="r")
        attributes = group.attrs.asdict()["egosplat"]
    if not isinstance(attributes, dict) or attributes.get("seal") != seal(attributes):
        raise damaged(path, "its attributes were changed after it was written")
    return group, _Attributes(attributes, path)


def _check_arrays(path: Path, schema: Schema, group: zarr.Group) -> dict[str, int]:
    """Check the layout of all arrays; return the size of each axis."""
    sizes: dict[str, int] = {}
    for name, declared in schema.fields.items():
        if not declared.optional or name in group:
            _check_array(path, group, name, declared, sizes)
    return sizes


def _check_array(path: Path, group: zarr.Group, name: str, declared: Field, sizes: dict[str, int]) -> None:
    def tell(error: Exception) -> ArtifactError:
        unreadable = f"unreadable ({type(error).__name__})"
        return damaged(path, f"array {name!r} is {'missing' if isinstance(error, KeyError) else unreadable}")

    with reraise_as(tell):
        array = group[name]
    if not isinstance(array, zarr.Array) or array.dtype != np.dtype(declared.dtype):
        raise damaged(path, f"array {name!r} is {getattr(array, 'dtype', 'a group')}, not {declared.dtype}")
    try:
        check_shape(declared, array.shape, sizes, name)
    except ValueError as error:
        raise damaged(path, f"array {error}") from None
    # Zarr reads a missing chunk as zeros, without an error.
    if array.size and (lost := array.nchunks - array.nchunks_initialized):
        raise damaged(path, f"array {name!r} lacks {lost} of {array.nchunks} chunks")
