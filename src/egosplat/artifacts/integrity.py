"""How damage to an artifact is noticed: a digest over its arrays, a seal over its attributes."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from egosplat.artifacts.schema import Schema
from egosplat.errors import UserError
from egosplat.refusals import refused


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


def check_replaceable(path: Path, schema: Schema) -> None:
    """Check that nothing is lost when an artifact takes a path: a mistyped output must not cost a folder of pictures.

    Raises:
        ArtifactError: something else stands there than an artifact of that kind, damaged or not, or an empty folder.
    """
    if path.is_symlink() or not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    kind = _kind(path / "zarr.json")
    if kind != schema.name:
        held = f"holds {kind!r}" if kind else "is no artifact"
        raise ArtifactError(
            f"{path}: stands there already and {held}; give another --output, or remove it first: rm -r {path}"
        )


def _kind(metadata: Path) -> str | None:
    """What an artifact's metadata calls it, if they can be read no further than that; None of anything else."""
    try:
        found = re.search(rb'"egosplat".*?"schema":\s*"(\w+)"', metadata.read_bytes(), re.DOTALL)
    except OSError as error:
        if refused(error):
            raise
        return None
    return found[1].decode() if found else None


def damaged(path: Path, what: str) -> ArtifactError:
    """The error for an artifact that cannot be trusted."""
    return ArtifactError(f"{path}: {what}. It is damaged; make it anew: {remedy(path)}")


def remedy(path: Path) -> str:
    """The commands that make an artifact anew."""
    return f"rm -r {path} && snakemake --cores 2 {path}"
