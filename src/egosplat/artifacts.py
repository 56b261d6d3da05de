"""What each artifact holds, and how it is written and read: whole, checked, with its provenance.

An artifact is a Zarr v3 group in one folder, described by a ``Schema``. No other module opens Zarr.

Writing: ``create`` makes the artifact whole or not at all (``egosplat.atomic``), so a path that exists is
complete.

Reading: ``open_artifact`` checks the schema, the format version, the seal over the attributes, and that no
chunk is missing; every chunk carries a CRC32C that is checked when it is read. ``verify`` also recomputes
the digest over all stored bytes.

Attributes: one dictionary under ``"egosplat"``: schema name and format version, ``digest`` (SHA-256 over
the stored arrays), ``provenance`` (how it was made), ``facts`` (small results that are no arrays), and
``seal`` (SHA-256 over all the others).
"""

import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec

from egosplat.atomic import whole_folder
from egosplat.errors import UserError
from egosplat.provenance import Provenance


class ArtifactError(UserError):
    """An artifact that is absent, damaged, or of another format version."""


@dataclass(frozen=True)
class Field:
    """One array of an artifact.

    Attributes:
        dims: name of each axis, or its fixed size. Axes of one name have one size within an artifact.
        dtype: NumPy name of the element type.
        unit: physical unit, or what the numbers count.
        about: what the array holds, with its axis convention.
        by_row: one chunk for each index of the first axis (large arrays that are read a frame at a time).
    """

    dims: tuple[str | int, ...]
    dtype: str
    unit: str
    about: str
    by_row: bool = False


@dataclass(frozen=True)
class Schema:
    """What an artifact of one kind holds. ``version`` grows when old artifacts can no longer be read."""

    name: str
    version: int
    fields: Mapping[str, Field] = field(default_factory=dict)


FRAMES = Schema(
    "frames",
    1,
    {
        "rgb": Field(("frame", "height", "width", 3), "uint8", "sRGB", "rectified pictures", by_row=True),
        "valid": Field(("height", "width"), "bool", "-", "pixels inside the lens circle"),
        "timestamp_ns": Field(("frame",), "int64", "ns", "capture time"),
        "exposure_middle_ns": Field(("frame",), "int64", "ns", "middle of the exposure; poses belong to it"),
        "train": Field(("frame",), "bool", "-", "frames to train on"),
        "evaluation": Field(("frame",), "bool", "-", "frames to evaluate on"),
    },
)

ANNOTATIONS = Schema(
    "annotations",
    1,
    {
        "frame": Field(("evaluation",), "int64", "index", "index of the evaluation frame in frames.zarr"),
        "annotated": Field(("evaluation",), "bool", "-", "whether the frame has an annotation"),
        "instance_map": Field(
            ("evaluation", "height", "width"),
            "int32",
            "index",
            "index into the instances of the facts, -1 where nothing is annotated",
            by_row=True,
        ),
    },
)

POSES = Schema(
    "poses",
    1,
    {
        "camera_to_world": Field(("frame", 4, 4), "float64", "m", "OpenCV axes; NaN where not registered"),
        "registered": Field(("frame",), "bool", "-", "frames that have a pose"),
        "intrinsics": Field((3, 3), "float64", "px", "pinhole matrix, pixel centres at + 0.5"),
        "up": Field((3,), "float64", "-", "unit vector against gravity, in the world"),
        "points/xyz": Field(("point", 3), "float64", "m", "points of the scene, in the world"),
        "points/rgb": Field(("point", 3), "uint8", "sRGB", "their colours"),
    },
)

SCHEMAS = {schema.name: schema for schema in (FRAMES, ANNOTATIONS, POSES)}


class Writer:
    """The arrays of an artifact while it is being made; given by ``create``."""

    def __init__(self, group: zarr.Group, schema: Schema) -> None:
        self._group = group
        self._schema = schema
        self._sizes: dict[str, int] = {}
        self._arrays: dict[str, zarr.Array] = {}
        self._rows_missing: dict[str, set[int]] = {}
        self.facts: dict[str, Any] = {}
        """Small results that are no arrays; plain JSON values."""

    def put(self, name: str, values: NDArray[Any]) -> None:
        """Store a whole array.

        Raises:
            ValueError: the shape or element type is not what the schema declares.
        """
        values = np.asarray(values)
        if values.dtype != np.dtype(self._declared(name).dtype):
            raise ValueError(f"{name}: {values.dtype} given, {self._declared(name).dtype} declared")
        self._create(name, values.shape)[...] = values

    def allocate(self, name: str, shape: tuple[int, ...]) -> None:
        """Begin an array that is written a row at a time with ``put_row``."""
        self._create(name, shape)
        self._rows_missing[name] = set(range(shape[0]))

    def put_row(self, name: str, index: int, values: NDArray[Any]) -> None:
        """Store row ``index`` of an allocated array; its shape and element type must match exactly."""
        array = self._arrays[name]
        if values.shape != array.shape[1:] or values.dtype != array.dtype:
            raise ValueError(
                f"{name}[{index}]: {values.dtype} {values.shape} given, {array.dtype} {array.shape[1:]} expected"
            )
        array[index] = values
        self._rows_missing[name].discard(index)

    def finish(self) -> None:
        """Check that everything declared was written."""
        missing = sorted(set(self._schema.fields) - set(self._arrays))
        if missing:
            raise ValueError(f"artifact {self._schema.name}: never written: {', '.join(missing)}")
        for name, rows in self._rows_missing.items():
            if rows:
                raise ValueError(f"artifact {self._schema.name}: {name} lacks {len(rows)} rows")

    def _declared(self, name: str) -> Field:
        if name not in self._schema.fields:
            raise ValueError(f"artifact {self._schema.name} declares no array {name!r}")
        return self._schema.fields[name]

    def _create(self, name: str, shape: tuple[int, ...]) -> zarr.Array:
        declared = self._declared(name)
        _check_shape(declared, shape, self._sizes, name)
        chunks = (1, *shape[1:]) if declared.by_row else shape
        array = self._group.create_array(
            name,
            shape=shape,
            dtype=declared.dtype,
            chunks=tuple(max(1, size) for size in chunks),
            compressors=[ZstdCodec(level=3), Crc32cCodec()],
            dimension_names=[dim if isinstance(dim, str) else None for dim in declared.dims],
            # An all-zero chunk is stored too: only then is a missing file known to be a loss.
            config={"write_empty_chunks": True},
            attributes={"unit": declared.unit, "about": declared.about},
        )
        self._arrays[name] = array
        return array


@contextlib.contextmanager
def create(path: Path, schema: Schema, provenance: Provenance) -> Iterator[Writer]:
    """Write an artifact; it appears at ``path`` when the block ends without error, else not at all.

    An artifact that stands at ``path`` already is replaced at that moment.

    Args:
        path: the folder to make.
        schema: what it will hold.
        provenance: how it is made; its clock is stopped at the end of the block.
    """
    with whole_folder(path) as scratch:
        # Mode "w" would make the folder anew, without its lock.
        writer = Writer(zarr.open_group(scratch, mode="a"), schema)
        yield writer
        writer.finish()
        _write_attributes(scratch, schema, provenance, writer.facts)


class Artifact:
    """A checked, read-only artifact; made by ``open_artifact``."""

    def __init__(self, path: Path, schema: Schema, group: zarr.Group, attributes: dict[str, Any]) -> None:
        self.path = path
        self.schema = schema
        self._group = group
        self._attributes = attributes

    @property
    def facts(self) -> dict[str, Any]:
        """Small results that are no arrays."""
        return self._attributes["facts"]

    @property
    def digest(self) -> str:
        """SHA-256 over the stored arrays."""
        return self._attributes["digest"]

    @property
    def provenance(self) -> dict[str, Any]:
        """How it was made: stage, options, inputs, versions, origin, time and memory."""
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
        if not array.size:
            return np.empty(array.shape, array.dtype)
        if self.schema.fields[name].by_row:
            return np.stack([self.row(name, index) for index in range(array.shape[0])])
        return self._checked(name, ...)

    def row(self, name: str, index: int) -> NDArray[Any]:
        """Read one index of the first axis. Raises as ``read``."""
        return self._checked(name, index)

    def _checked(self, name: str, selection: Any) -> NDArray[Any]:
        try:
            return np.asarray(self._group[name][selection])
        except (ValueError, RuntimeError, OSError, KeyError) as error:
            where = "" if selection is ... else f", chunk {selection}"
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise damaged(self.path, f"array {name!r}{where} cannot be read ({reason})") from error


def open_artifact(path: Path, schema: Schema) -> Artifact:
    """Open an artifact and check all that can be checked without reading its arrays.

    Raises:
        ArtifactError: it is absent, of another kind or version, or damaged; says how to make it anew.
    """
    group, attributes = _open(path)
    found = attributes.get("schema")
    if found != schema.name:
        raise ArtifactError(f"{path}: holds {found!r}, not {schema.name!r}. Give the {schema.name} artifact.")
    version = attributes["format_version"]
    if version != schema.version:
        hint = "Update egosplat" if version > schema.version else f"Make it anew: {_remedy(path)}"
        raise ArtifactError(
            f"{path}: has format version {version}, this is version {schema.version}. {hint}."
        )
    sizes: dict[str, int] = {}
    for name, declared in schema.fields.items():
        _check_array(path, group, name, declared, sizes)
    return Artifact(path, schema, group, attributes)


def verify(path: Path) -> Artifact:
    """Open an artifact of any kind and also check every stored byte against its digest.

    Raises:
        ArtifactError: as ``open_artifact``, or some file was changed, added or removed.
    """
    _, attributes = _open(path)
    schema = SCHEMAS.get(attributes.get("schema", ""))
    if schema is None:
        raise ArtifactError(
            f"{path}: holds {attributes.get('schema')!r}, a kind that this egosplat does not know."
        )
    artifact = open_artifact(path, schema)
    if _digest(path) != artifact.digest:
        for name in schema.fields:  # names the chunk, where it is a chunk
            artifact.read(name)
        raise damaged(path, "its files are not those that were written (digest differs)")
    return artifact


def damaged(path: Path, what: str) -> ArtifactError:
    """The error for an artifact that cannot be trusted."""
    return ArtifactError(f"{path}: {what}. It is damaged; make it anew: {_remedy(path)}")


def _remedy(path: Path) -> str:
    return f"rm -r {path} && snakemake --cores 2 {path}"


def _open(path: Path) -> tuple[zarr.Group, dict[str, Any]]:
    if not path.exists():
        raise ArtifactError(f"{path}: does not exist. Make it: snakemake --cores 2 {path}")
    try:
        group = zarr.open_group(path, mode="r")
        attributes = group.attrs.asdict()["egosplat"]
    except KeyError:
        raise ArtifactError(
            f"{path}: is a Zarr group that egosplat did not write. Give an artifact."
        ) from None
    except Exception as error:  # zarr raises many kinds for an unreadable group
        raise damaged(path, f"is no readable Zarr group ({type(error).__name__})") from error
    if not isinstance(attributes, dict) or attributes.get("seal") != _seal(attributes):
        raise damaged(path, "its attributes were changed after it was written")
    return group, attributes


def _check_array(path: Path, group: zarr.Group, name: str, declared: Field, sizes: dict[str, int]) -> None:
    try:
        array = group[name]
    except KeyError:
        raise damaged(path, f"array {name!r} is missing") from None
    except Exception as error:
        raise damaged(path, f"array {name!r} is unreadable ({type(error).__name__})") from error
    if array.dtype != np.dtype(declared.dtype):
        raise damaged(path, f"array {name!r} is {array.dtype}, not {declared.dtype}")
    try:
        _check_shape(declared, array.shape, sizes, name)
    except ValueError as error:
        raise damaged(path, f"array {error}") from None
    if array.size and (lost := array.nchunks - array.nchunks_initialized):
        raise damaged(path, f"array {name!r} lacks {lost} of {array.nchunks} chunks")


def _check_shape(declared: Field, shape: tuple[int, ...], sizes: dict[str, int], name: str) -> None:
    """Check ``shape`` against the declared axes and the sizes seen so far, which it adds to."""
    if len(shape) != len(declared.dims):
        raise ValueError(f"{name!r} has {len(shape)} axes, not {len(declared.dims)}")
    for dim, size in zip(declared.dims, shape, strict=True):
        expected = dim if isinstance(dim, int) else sizes.setdefault(dim, size)
        if size != expected:
            raise ValueError(f"{name!r} has size {size} along axis {dim!r}, not {expected}")


def _write_attributes(scratch: Path, schema: Schema, provenance: Provenance, facts: dict[str, Any]) -> None:
    attributes = {
        "schema": schema.name,
        "format_version": schema.version,
        "digest": _digest(scratch),
        "provenance": provenance.record(),
        "facts": facts,
    }
    # Through JSON once, so that the seal is over what a reader will see.
    attributes = json.loads(json.dumps(attributes, allow_nan=False))
    attributes["seal"] = _seal(attributes)
    zarr.open_group(scratch, mode="a").attrs.put({"egosplat": attributes})


def _seal(attributes: dict[str, Any]) -> str:
    rest = {key: value for key, value in attributes.items() if key != "seal"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _digest(root: Path) -> str:
    """SHA-256 over path and bytes of all files but the root's own metadata and hidden files."""
    digest = hashlib.sha256()
    files = (file for file in root.rglob("*") if file.is_file() and not file.name.startswith("."))
    for file in sorted(files):
        name = file.relative_to(root).as_posix()
        if name != "zarr.json":
            with file.open("rb") as stream:
                digest.update(f"{name}\0{hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode())
    return digest.hexdigest()
