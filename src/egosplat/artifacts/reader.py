"""Read artifacts with checks.

Opening checks schema, version, seal and completeness. Reading checks the CRC32C of each chunk. ``verify`` checks every byte.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from egosplat.artifacts.integrity import ArtifactError, absent, damaged, digest_of, rebuild_command, seal
from egosplat.artifacts.schema import Field, Schema, check_shape
from egosplat.errors import reraise_as


class Artifact:
    """A checked, read-only artifact; made by ``open_artifact``."""

    def __init__(self, path: Path, schema: Schema, group: zarr.Group, attributes: dict[str, Any]) -> None:
        self.path = path
        self.schema = schema
        self._group = group
        self._attributes = attributes

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

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of an array, without reading it."""
        return self._group[name].shape

    def read(self, name: str) -> NDArray[Any]:
        """Read a whole array.

        Raises:
            ArtifactError: a chunk does not match its checksum.
        """
        array = self._group[name]
        values = np.empty(array.shape, array.dtype)
        if values.size:
            # One chunk at a time, so that an error names the damaged chunk.
            rows = array.chunks[0]
            for start in range(0, len(values), rows):
                values[start : start + rows] = self._checked(array, name, slice(start, start + rows))
        return values

    def row(self, name: str, index: int) -> NDArray[Any]:
        """Read one index of the first axis. Raises as ``read``."""
        return self._checked(self._group[name], name, index)

    def _checked(self, array: zarr.Array, name: str, selection: int | slice) -> NDArray[Any]:
        def tell(error: Exception) -> ArtifactError:
            first = selection.start if isinstance(selection, slice) else selection
            where = "" if array.nchunks == 1 else f", chunk {first // array.chunks[0]}"
            return damaged(self.path, f"array {name!r}{where} cannot be read ({_reason(error)})")

        with reraise_as(tell, (ValueError, RuntimeError, OSError, KeyError)):
            return np.asarray(array[selection])


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
        hint = "Update egosplat" if version > schema.version else f"Rebuild it: {rebuild_command(path)}"
        raise ArtifactError(
            f"{path}: has format version {version}, this is version {schema.version}. {hint}."
        )
    sizes: dict[str, int] = {}
    for name, declared in schema.fields.items():
        _check_array(path, group, name, declared, sizes)
    return Artifact(path, schema, group, attributes)


def open_any(path: Path, schemas: Mapping[str, Schema]) -> Artifact:
    """Open an artifact of any kind in ``schemas``, by name.

    Raises:
        ArtifactError: as ``open_artifact``, or the artifact is of no kind in ``schemas``.
    """
    group, attributes = _open(path)
    schema = schemas.get(attributes.get("schema", ""))
    if schema is None:
        raise ArtifactError(
            f"{path}: holds {attributes.get('schema')!r}, a kind that this egosplat does not know."
        )
    return _checked_artifact(path, schema, group, attributes)


def verify(path: Path, schemas: Mapping[str, Schema]) -> Artifact:
    """Open an artifact of any kind in ``schemas`` and check every stored byte against its digest.

    Raises:
        ArtifactError: as ``open_any``, or a file was changed, added or removed.
    """
    artifact = open_any(path, schemas)
    if digest_of(path) != artifact.digest:
        for name in artifact.schema.fields:  # raises with the name of the damaged chunk
            artifact.read(name)
        raise damaged(path, "its files are not those that were written (digest differs)")
    return artifact


def recorded_digest(path: Path) -> str:
    """The digest in an artifact's attributes; no array is read.

    Raises:
        ArtifactError: its attributes cannot be trusted.
    """
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
    return group, attributes


def _check_array(path: Path, group: zarr.Group, name: str, declared: Field, sizes: dict[str, int]) -> None:
    def tell(error: Exception) -> ArtifactError:
        unreadable = f"unreadable ({type(error).__name__})"
        return damaged(path, f"array {name!r} is {'missing' if isinstance(error, KeyError) else unreadable}")

    with reraise_as(tell):
        array = group[name]
    if array.dtype != np.dtype(declared.dtype):
        raise damaged(path, f"array {name!r} is {array.dtype}, not {declared.dtype}")
    try:
        check_shape(declared, array.shape, sizes, name)
    except ValueError as error:
        raise damaged(path, f"array {error}") from None
    if array.size and (lost := array.nchunks - array.nchunks_initialized):
        raise damaged(path, f"array {name!r} lacks {lost} of {array.nchunks} chunks")
