"""How damage to an artifact is noticed: a digest over its arrays, a seal over its attributes."""

import hashlib
import json
from pathlib import Path
from typing import Any

from egosplat.errors import UserError


class ArtifactError(UserError):
    """An artifact that is absent, damaged, or of another format version."""


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


def damaged(path: Path, what: str) -> ArtifactError:
    """The error for an artifact that cannot be trusted."""
    return ArtifactError(f"{path}: {what}. It is damaged; make it anew: {remedy(path)}")


def remedy(path: Path) -> str:
    """The commands that make an artifact anew."""
    return f"rm -r {path} && snakemake --cores 2 {path}"
