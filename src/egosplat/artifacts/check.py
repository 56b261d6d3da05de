"""Verification of a whole folder of results: ``egosplat check``."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from egosplat.artifacts.consistency import made_from_another
from egosplat.artifacts.integrity import rebuild_command
from egosplat.artifacts.reader import recorded_digest, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError, user_message
from egosplat.pipeline.validation import read_document

# The schema of each JSON file of results.
DOCUMENTS = {"metrics.json": "metrics", "survey.json": "survey"}


def check_tree(folder: Path, say: Callable[[str], object]) -> dict[Path, str]:
    """Verify ``*.zarr`` and files of ``DOCUMENTS`` at or below a folder: the problem of each, empty if it is sound.

    Bytes match the digest, a JSON file its schema, and an input in the same folder the digest of the provenance.

    Raises:
        UserError: the folder holds no artifact.
    """
    paths = [folder] if _is_result(folder) else sorted(filter(_is_result, folder.rglob("*")))
    if not paths:
        raise UserError(f"{folder}: holds no artifact. Give a folder of results, such as results/adt/scene1")
    problems = {}
    for path in paths:
        problems[path] = problem = _problem(path)
        say(f"{'NOT OK ' if problem else 'ok     '} {problem or path}")
    return problems


def _is_result(path: Path) -> bool:
    return path.suffix == ".zarr" or path.name in DOCUMENTS


def _problem(path: Path) -> str:
    try:
        return _changed_input(path, _provenance(path))
    except (UserError, OSError) as error:
        return user_message(error) or f"{path}: {error}"


def _provenance(path: Path) -> dict[str, Any]:
    """Provenance of an artifact or JSON file after its verification."""
    if path.suffix == ".zarr":
        return verify(path, SCHEMAS).provenance
    if not path.is_file():
        raise UserError(f"{path}: is no regular file. Rebuild it: {rebuild_command(path)}")
    return read_document(path, DOCUMENTS[path.name])["provenance"]


def _changed_input(path: Path, provenance: dict[str, Any]) -> str:
    for name, digest in provenance["inputs"].items():
        # A damaged input has its own line in the report.
        with contextlib.suppress(UserError, OSError):
            if recorded_digest(path.parent / name) != digest:
                return str(made_from_another(path, path.parent / name))
    return ""
