"""Find the artifacts of a scene or a variant from its folder alone."""

from pathlib import Path

from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.reader import Artifact, open_any, recorded_digest
from egosplat.artifacts.registry import SCHEMAS
from egosplat.pipeline.home import shared_with
from egosplat.pipeline.validation import read_document


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
