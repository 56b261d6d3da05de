"""Verification of a whole folder of results: ``egosplat check``."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.kinds import SCHEMAS
from egosplat.artifacts.reading import Artifact, recorded_digest, verify
from egosplat.errors import UserError
from egosplat.plain_errors import plain


@dataclass(frozen=True)
class Report:
    """What was found of one artifact; ``problem`` is empty where it is sound."""

    path: Path
    problem: str

    @property
    def sound(self) -> bool:
        return not self.problem


def check_tree(folder: Path, say: Callable[[str], object]) -> list[Report]:
    """Verify every ``*.zarr`` at or below ``folder`` and tell each result through ``say``.

    An artifact is sound if its bytes match its digest and every input that its provenance names and that
    lies beside it is still the one it was made from.

    Raises:
        UserError: there is no artifact.
    """
    paths = [folder] if folder.suffix == ".zarr" else sorted(folder.rglob("*.zarr"))
    if not paths:
        raise UserError(f"{folder}: holds no artifact. Give a folder of results, such as results/adt/scene1")
    reports = []
    for path in paths:
        report = Report(path, _problem(path))
        say(f"{'ok     ' if report.sound else 'NOT OK '} {report.problem or path}")
        reports.append(report)
    return reports


def _problem(path: Path) -> str:
    try:
        artifact = verify(path, SCHEMAS)
        return _changed_input(artifact)
    except (UserError, OSError) as error:
        return plain(error) or f"{path}: {error}"


def _digest_of(path: Path) -> str | None:
    """An artifact's recorded digest; None where it is absent, damaged or refused, which its own report tells."""
    try:
        return recorded_digest(path)
    except (UserError, OSError):
        return None


def _changed_input(artifact: Artifact) -> str:
    for name, digest in artifact.provenance["inputs"].items():
        beside = artifact.path.parent / name
        if _digest_of(beside) not in (digest, None):
            return f"{artifact.path}: was made from another {name} than the one beside it; make it anew"
    return ""
