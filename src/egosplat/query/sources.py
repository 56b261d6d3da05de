"""The artifacts that queries read."""

from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.query.text import encoded_of


@dataclass(frozen=True)
class QuerySources:
    """Artifacts of one scene; ``encoded`` is its features, or the tiles that its codes were learnt from."""

    frames: Artifact
    poses: Artifact
    splats: Artifact
    language: Artifact
    encoded: Artifact


def find_sources(folder: Path) -> list[Path]:
    """Find the artifacts of a scene or a variant, in the order of ``QuerySources``.

    Raises:
        UserError: the language artifact cannot be opened; also as ``locate``.
    """
    *paths, features, tiles = locate(folder, "frames", "poses", "splats", "language", "features", "tiles")
    by_tiles = encoded_of(open_artifact(paths[-1], LANGUAGE)) == "tiles"
    return [*paths, tiles if by_tiles else features]
