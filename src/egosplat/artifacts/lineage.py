"""Find all artifacts that an artifact was made from, back to the recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_any, recorded_digest
from egosplat.artifacts.registry import SCHEMAS
from egosplat.pipeline.home import shared_with


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
    """Find the inputs of artifacts by digest, where variants share them; UserError if two differ or one is damaged."""
    own = [artifact.path.parent for artifact in artifacts]
    folders = list(dict.fromkeys([*own, *(place for folder in own for place in shared_with(folder))]))
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
