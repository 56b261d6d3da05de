"""What artifacts were made from, back to the recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_any, recorded_digest
from egosplat.artifacts.registry import SCHEMAS


@dataclass(frozen=True)
class Lineage:
    """Some artifacts with all that they were made from.

    Attributes:
        found: by file name, sorted.
        lost: names of those that lie beside none of them any more, or only another of that name does; sorted.
    """

    found: Mapping[str, Artifact]
    lost: tuple[str, ...]


def lineage(artifacts: Sequence[Artifact]) -> Lineage:
    """Follow the digests that artifacts record of their inputs; these are looked for beside any of the artifacts, and
    in all variants of the same scene.

    Raises:
        UserError: two of them were made from different artifacts of one name, or one is damaged.
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
    """Where to look, in order: a variant may have inputs from another that it stands over."""
    variants = (sorted(folder.parent.iterdir()) for folder in own if folder.parent.name == "variants")
    return list(dict.fromkeys([*own, *(folder for folders in variants for folder in folders)]))
