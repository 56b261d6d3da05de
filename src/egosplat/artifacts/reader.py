"""Read artifacts with checks. Opening checks schema, version, seal and completeness. Reading checks the
CRC32C of each chunk, and its numbers by the schema. ``verify`` checks every byte and number. Zarr finds the
codec of pictures, ``jpeg``, only once it is imported."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from egosplat.artifacts import jpeg  # noqa: F401
from egosplat.artifacts.integrity import ArtifactError, absent, damaged, digest_of, rebuild_command, seal
from egosplat.artifacts.schema import Field, Schema, check_shape, sizes_of
from egosplat.errors import UserError, reraise_as


class _Attributes(dict[str, Any]):
    """Attributes of an artifact; one that is missing, as in an artifact of an older egosplat, is an ``ArtifactError``."""

    def __init__(self, values: Mapping[str, Any], path: Path) -> None:
        self.path = path
        super().__init__(values)
        inner = {key: value for key, value in values.items() if isinstance(value, dict)}
        self.update({key: _Attributes(value, path) for key, value in inner.items()})

    def __missing__(self, key: str) -> Any:
        raise damaged(self.path, f"its attributes lack {key!r}")


class Artifact:
    """A checked, read-only artifact, made by ``open_artifact`` or ``open_any``. ``facts`` are small results
    that are not arrays; ``digest`` is SHA-256 over the arrays; ``origin`` is ``real`` or ``synthetic``; ``sizes`` are those of axes and lists."""

    def __init__(self, path: Path, schema: Schema, group: zarr.Group, attributes: dict[str, Any]) -> None:
        self.path, self.schema, self._group = path, schema, group
        self.facts: dict[str, Any] = attributes["facts"]
        self.digest: str = attributes["digest"]
        self.provenance: dict[str, Any] = attributes["provenance"]
        self.origin: str = self.provenance["origin"]
        sizes: dict[str, int] = {}
        for name, declared in schema.fields.items():
            if not declared.optional or name in group:
                _check_array(path, group, name, declared, sizes)
        self.sizes = sizes_of(sizes, self.facts)

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
        if (array := self._group.get(name)) is None:
            raise UserError(f"{self.path}: no array {name!r} in {', '.join(self.arrays)}")
        assert isinstance(array, zarr.Array)  # checked when it was opened
        return array

    def read(self, name: str) -> NDArray[Any]:
        """Read a whole array; ArtifactError if a chunk's checksum differs, or the schema does not allow a number."""
        array = self._array(name)
        if array.nchunks == 1:
            return self._checked(array, name, slice(0, array.shape[0]))
        values = np.empty(array.shape, array.dtype)
        for start, chunk in self.chunks(name):
            values[start : start + len(chunk)] = chunk
        return values

    def row(self, name: str, index: int) -> NDArray[Any]:
        """Read one index of the first axis. Raises as ``read``."""
        return self._checked(self._array(name), name, index)

    def chunks(self, name: str) -> Iterator[tuple[int, NDArray[Any]]]:
        """Read first row and values of each chunk, so that an error names the damaged one. Raises as ``read``."""
        array = self._array(name)
        # A matrix or vector of fixed size has one chunk.
        for start in range(0, array.shape[0] if array.size else 0, array.chunks[0]):
            yield start, self._checked(array, name, slice(start, start + array.chunks[0]))

    def _checked(self, array: zarr.Array, name: str, selection: int | slice) -> NDArray[Any]:
        first = selection.start if isinstance(selection, slice) else selection
        where = f"array {name!r}" + ("" if array.nchunks == 1 else f", chunk {first // array.chunks[0]}")

        def tell(error: Exception) -> ArtifactError:
            # The bytes of a checksum do not help a user.
            reason = str(error).partition("\n")[0] or type(error).__name__
            reason = "its checksum does not match" if "checksum" in reason else reason
            return damaged(self.path, f"{where} cannot be read ({reason})")

        with reraise_as(tell, (ValueError, RuntimeError, OSError, KeyError)):
            values = np.asarray(array[selection])
        if fault := self.schema.fields[name].values.find_fault(values, self.sizes):
            raise damaged(self.path, f"{where} {fault}")
        return values


def open_artifact(path: Path, schema: Schema) -> Artifact:
    """Open an artifact and check all that can be checked without reading its arrays. ArtifactError: it is
    absent, of another kind or version, or damaged; the message says how to rebuild it. OSError, MemoryError,
    RuntimeError: a system error, see ``egosplat.errors``."""
    group, attributes = _open(path)
    if (kind := attributes.get("schema")) != schema.name:
        raise ArtifactError(f"{path}: holds {kind!r}, not {schema.name!r}. Give the {schema.name} artifact.")
    return _of_version(path, schema, group, attributes)


def open_needed(by: str, *given: tuple[Path | None, Schema]) -> list[Artifact]:
    """Open what a value of a key needs, such as ``splats.masking = refined`` (UserError: a path is not given)."""
    if missing := [schema.name for path, schema in given if path is None]:
        flags = " and ".join(f"--{name}" for name in missing)
        raise UserError(f"{by} needs the artifact of {' and '.join(missing)}: give {flags}")
    return [open_artifact(path, schema) for path, schema in given if path is not None]


def open_any(path: Path, schemas: Mapping[str, Schema]) -> Artifact:
    """Open an artifact of any kind in ``schemas``; ArtifactError as ``open_artifact``, or for another kind."""
    group, attributes = _open(path)
    if (kind := attributes.get("schema", "")) not in schemas:
        raise ArtifactError(f"{path}: holds {kind!r}, a kind that this egosplat does not know.")
    return _of_version(path, schemas[kind], group, attributes)


def verify(path: Path, schemas: Mapping[str, Schema]) -> Artifact:
    """Open an artifact of any kind in ``schemas``; check every stored byte against its digest, and every
    number (ArtifactError: as ``open_any``, a file was changed, added or removed, or the schema does not allow
    a number)."""
    artifact = open_any(path, schemas)
    changed = digest_of(path) != artifact.digest
    for name in artifact.arrays:  # raises with the name of the damaged chunk
        declared = artifact.schema.fields[name]
        if changed or declared.values.limits(declared.dtype):
            for _ in artifact.chunks(name):
                pass
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
            what = "is a Zarr group that egosplat did not write. Give an artifact of egosplat"
            return ArtifactError(f"{path}: {what}")
        return damaged(path, f"is no readable Zarr group ({type(error).__name__})")

    with reraise_as(tell):
        group = zarr.open_group(path, mode="r")
        attributes = group.attrs.asdict()["egosplat"]
    if not isinstance(attributes, dict) or attributes.get("seal") != seal(attributes):
        raise damaged(path, "its attributes were changed after it was written")
    return group, _Attributes(attributes, path)


def _of_version(path: Path, schema: Schema, group: zarr.Group, attributes: dict[str, Any]) -> Artifact:
    version = attributes["format_version"]
    if version != schema.version:
        newer = isinstance(version, int) and version > schema.version
        hint = "Update egosplat" if newer else f"Rebuild it: {rebuild_command(path)}"
        told = f"has format version {version}, this is version {schema.version}. {hint}."
        raise ArtifactError(f"{path}: {told}")
    return Artifact(path, schema, group, attributes)


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
    # Zarr reads a missing chunk as zeros, without an error. It counts a last shard that is not full as full.
    if array.size and array.nchunks_initialized < array.nchunks:
        raise damaged(path, f"array {name!r} lacks chunks")
