"""Find all artifacts that an artifact was made from, back to the recording, and those of a scene or variant from its folder alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_any, recorded_digest
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.pipeline.home import shared_with
from egosplat.pipeline.validation import read_document


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


def locate(folder: Path, *names: str) -> list[Path]:
    """The path of each artifact of a scene or variant, which shares artifacts with its scene and other variants.

    Where the artifact is not there, it is in ``folder``.

    Raises:
        UserError: an artifact or metrics.json of the variant is damaged, or its artifacts do not belong together.
    """
    found: dict[str, Path] = {}
    if folder.parent.name == "variants" and (own := _own(folder)):
        found = {name: artifact.path for name, artifact in lineage(own).found.items()}
    return [found.get(f"{name}.zarr", folder / f"{name}.zarr") for name in names]


def open_histories(folder: Path, splats: Artifact) -> Artifact | None:
    """Open histories.zarr of a scene or variant; None if none was made from these Gaussians.

    Raises:
        UserError: one is damaged.
    """
    paths = (place / "histories.zarr" for place in (folder, *shared_with(folder)))
    made = (open_any(path, SCHEMAS) for path in paths if path.exists())
    return next((one for one in made if one.provenance["inputs"][splats.path.name] == splats.digest), None)


def _own(folder: Path) -> list[Artifact]:
    """The artifacts in a variant's folder, and the codes of which it has only scores."""
    own = [open_any(path, SCHEMAS) for path in sorted(folder.glob("*.zarr"))]
    scores = folder / "metrics.json"
    if all(artifact.schema.name != "language" for artifact in own) and scores.exists():
        digest = read_document(scores, "metrics")["provenance"]["inputs"]["language.zarr"]
        places = (place / "language.zarr" for place in shared_with(folder))
        own += [
            open_any(path, SCHEMAS) for path in places if path.exists() and recorded_digest(path) == digest
        ][:1]
    return own
