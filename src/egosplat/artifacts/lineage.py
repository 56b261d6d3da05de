"""Find all artifacts that an artifact was made from, back to the recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_any, recorded_digest
from egosplat.artifacts.registry import SCHEMAS


@dataclass(frozen=True)
class Lineage:
    """Artifacts with everything that they were made from.

    Attributes:
        found: the artifacts by file name, sorted.
        lost: sorted file names of inputs that are absent, or that only differ in digest from one that is there.
    """

    found: Mapping[str, Artifact]
    lost: tuple[str, ...]


def lineage(artifacts: Sequence[Artifact]) -> Lineage:
    """Find the inputs of artifacts by their recorded digests, in the folders of the artifacts and in all variants of the scene.

    Raises:
        UserError: two artifacts were made from different inputs of one name, or an artifact is damaged.
    """
    folders = _folders([artifact.path.parent for artifact in artifacts])
    found = {artifact.path.name: artifact for artifact in artifacts}
    lost: set[str] = set()
    todo = list(artifacts)
    while todo:
        artifact = todo.pop()
        for name, digest in artifact.provenance["inputs"].items():
            if name in found:
                check_made_from(artifact, found[name])
                continue
            paths = (folder / name for folder in folders)
            path = next((one for one in paths if one.exists() and recorded_digest(one) == digest), None)
            if path is None:
                lost.add(name)
            else:
                found[name] = open_any(path, SCHEMAS)
                todo.append(found[name])
    return Lineage(dict(sorted(found.items())), tuple(sorted(lost)))


def _folders(own: Sequence[Path]) -> list[Path]:
    """The folders to search, in order."""
    # A variant shares inputs with the variants that it extends.
    variants = (sorted(folder.parent.iterdir()) for folder in own if folder.parent.name == "variants")
    return list(dict.fromkeys([*own, *(folder for folders in variants for folder in folders)]))
