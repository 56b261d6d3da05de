"""Results of a run without a target, and inputs of the tables."""

from collections.abc import Iterable
from pathlib import Path

from egosplat.pipeline.dag import default_pages
from egosplat.pipeline.scenes import Scene

# Variants that have rows in the tables, in addition to the scene itself.
ABLATIONS = ("baseline", "no_masks", "network_masks")


def default_scenes(scenes: Iterable[Scene]) -> list[Scene]:
    """Get the scenes of a run without a target: those with a recording, and synthetic ones that need not be named."""
    return [scene for scene in scenes if not scene.by_name and (scene.synthetic or scene.recording.exists())]


def default_results(scene: Scene) -> list[str]:
    """Get the paths that such a run makes for a scene, except those that its survey decides."""
    return [str(scene.results / name) for name in default_pages(scene.config["splats"]["masking"])]


def table_scores(scenes: Iterable[Scene]) -> list[str]:
    """Get metrics.json of scenes and their ablations; for scenes that must be named, only existing files."""
    scenes = list(scenes)
    own = [path for scene in default_scenes(scenes) for path in _scores(scene)]
    by_name = [path for scene in scenes if scene.by_name for path in _scores(scene) if path.exists()]
    return [str(path) for path in (*own, *by_name)]


def table_pictures(scenes: Iterable[Scene]) -> list[str]:
    """Get the figures on the tables page."""
    names = ("splats.png", "language.png")
    return [str(scene.results / name) for scene in default_scenes(scenes) for name in names]


def _scores(scene: Scene) -> list[Path]:
    folders = ("", *(f"variants/{name}" for name in ABLATIONS))
    return [scene.results / folder / "metrics.json" for folder in folders]
