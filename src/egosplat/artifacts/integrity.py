"""Detect damage to an artifact: a digest over its arrays, a seal over its attributes."""

import hashlib
import json
import re
import shlex
from pathlib import Path
from typing import Any

from egosplat.artifacts.schema import Schema
from egosplat.errors import UserError, is_system_error
from egosplat.pipeline.home import make_command

_ADVICE = "Give an artifact of egosplat, such as results/adt/scene1/frames.zarr"

# Where the workflow puts artifacts and JSON files.
_RESULT = re.compile(r"(^|/)results/[a-z0-9_]+/[A-Za-z0-9_-]+/(variants/[A-Za-z0-9_-]+/)?\w+\.(zarr|json)$")


class ArtifactError(UserError):
    """An artifact is absent, damaged, or of another format version."""


def seal(attributes: dict[str, Any]) -> str:
    """SHA-256 over all attributes but the seal itself."""
    rest = {key: value for key, value in attributes.items() if key != "seal"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def digest_of(root: Path) -> str:
    """SHA-256 over path and bytes of all files but the root's own metadata and hidden files."""
    digest = hashlib.sha256()
    files = (file for file in root.rglob("*") if file.is_file() and not file.name.startswith("."))
    for file in sorted(files):
        name = file.relative_to(root).as_posix()
        if name != "zarr.json":
            with file.open("rb") as stream:
                digest.update(f"{name}\0{hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode())
    return digest.hexdigest()


def check_replaceable(path: Path, schema: Schema) -> None:
    """Raise ArtifactError unless a path is free, an empty folder, or an artifact of the same kind, damaged or not."""
    # A mistyped --output must not delete a folder of pictures.
    if path.is_symlink() or not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    kind = _kind(path / "zarr.json")
    if kind is None:
        raise ArtifactError(f"{path}: is there already and is no artifact of egosplat; give another --output")
    if kind != schema.name:
        advice = f"give another --output, or remove it first: rm -r {shlex.quote(str(path))}"
        raise ArtifactError(f"{path}: is there already and holds {kind!r}; {advice}")


def _kind(metadata: Path) -> str | None:
    """The schema name in an artifact's metadata, also if the rest is damaged; None if there is none."""
    try:
        found = re.search(rb'"egosplat".*?"schema":\s*"(\w+)"', metadata.read_bytes(), re.DOTALL)
    except OSError as error:
        if is_system_error(error):
            raise
        return None
    return found[1].decode() if found else None


def damaged(path: Path, what: str) -> ArtifactError:
    """The error for a damaged artifact, or for something else in its place."""
    # A message must not tell a user to remove what egosplat did not write, by its metadata or its place.
    if _RESULT.search(path.as_posix()) or _kind(path / "zarr.json") is not None:
        return ArtifactError(f"{path}: {what}. It is damaged. Rebuild it: {rebuild_command(path)}")
    return ArtifactError(f"{path}: {what}. {_ADVICE}")


def absent(path: Path) -> ArtifactError:
    """The error for an artifact that is not there."""
    advice = f"Make it: {make_command(path)}" if _RESULT.search(path.as_posix()) else _ADVICE
    return ArtifactError(f"{path}: does not exist. {advice}")


def rebuild_command(path: Path) -> str:
    """The shell commands that remove and rebuild a result. Outside the workflow's folders, only the removal is known."""
    then = " &&" if _RESULT.search(path.as_posix()) else ", then"
    return f"rm -r {shlex.quote(str(path))}{then} {make_command(path)}"
