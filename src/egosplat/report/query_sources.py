"""The artifacts that a query reads."""

from dataclasses import dataclass

from egosplat.artifacts.reader import Artifact


@dataclass(frozen=True)
class QuerySources:
    """Artifacts of one scene that belong together."""

    frames: Artifact
    poses: Artifact
    features: Artifact
    splats: Artifact
    language: Artifact
