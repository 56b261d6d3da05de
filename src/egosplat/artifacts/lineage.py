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
    """Find the inputs of artifacts by their recorded digests, in their folders and those of ``searched_folders``.

    Raises:
        UserError: two artifacts were made from different inputs of one name, or an artifact is damaged.
    """
    folders = searched_folders([artifact.path.parent for artifact in artifacts])
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


def searched_folders(own: Sequence[Path]) -> list[Path]:
    """List folders that may hold inputs, in order: ``own`` ones, then the scene and all variants of an own variant."""
    # A variant shares inputs with its scene and with the variants that it extends.
    variants = [folder.parent for folder in own if folder.parent.name == "variants"]
    shared = [place for folder in variants for place in (folder.parent, *sorted(folder.iterdir()))]
    return list(dict.fromkeys([*own, *shared]))
