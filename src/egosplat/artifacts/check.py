"""Verification of a whole folder of results: ``egosplat check``."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.artifacts.consistency import made_from_another
from egosplat.artifacts.integrity import rebuild_command
from egosplat.artifacts.reader import recorded_digest, verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.errors import UserError, user_message
from egosplat.pipeline import config as configuration

DOCUMENTS = {"metrics.json": "metrics", "survey.json": "survey", "tradeoff.json": "tradeoff"}
"""The schema of each JSON file of results."""


@dataclass(frozen=True)
class Report:
    """What was found of one artifact; ``problem`` is empty where it is sound."""

    path: Path
    problem: str

    @property
    def sound(self) -> bool:
        return not self.problem


def check_tree(folder: Path, say: Callable[[str], object]) -> list[Report]:
    """Verify every ``*.zarr`` and every file of ``DOCUMENTS`` at or below ``folder``; tell each result through ``say``.

    An artifact is sound if its bytes match its digest, a JSON file if it is what its schema describes; and every input
    that the provenance of either names and that is beside it is still the one it was made from.

    Raises:
        UserError: there is none.
    """
    paths = [folder] if _is_result(folder) else sorted(filter(_is_result, folder.rglob("*")))
    if not paths:
        raise UserError(f"{folder}: holds no artifact. Give a folder of results, such as results/adt/scene1")
    reports = []
    for path in paths:
        report = Report(path, _problem(path))
        say(f"{'ok     ' if report.sound else 'NOT OK '} {report.problem or path}")
        reports.append(report)
    return reports


def _is_result(path: Path) -> bool:
    return path.suffix == ".zarr" or path.name in DOCUMENTS


def _problem(path: Path) -> str:
    try:
        return _changed_input(path, _provenance(path))
    except (UserError, OSError) as error:
        return user_message(error) or f"{path}: {error}"


def _provenance(path: Path) -> dict[str, Any]:
    """What a verified artifact or JSON file tells of how it was made; a trade-off tells nothing."""
    if path.suffix == ".zarr":
        return verify(path, SCHEMAS).provenance
    if not path.is_file():
        raise UserError(f"{path}: is no regular file. Rebuild it: {rebuild_command(path)}")
    try:
        return configuration.read_document(path, DOCUMENTS[path.name]).get("provenance", {"inputs": {}})
    except UserError as error:
        end = "" if str(error).endswith((".", "?")) else "."
        raise UserError(f"{error}{end} Rebuild it: {rebuild_command(path)}") from None


def _digest_of(path: Path) -> str | None:
    """An artifact's recorded digest; None where it is absent, damaged or refused, which its own report tells."""
    try:
        return recorded_digest(path)
    except (UserError, OSError):
        return None


def _changed_input(path: Path, provenance: dict[str, Any]) -> str:
    for name, digest in provenance["inputs"].items():
        if _digest_of(path.parent / name) not in (digest, None):
            return str(made_from_another(path, path.parent / name))
    return ""
