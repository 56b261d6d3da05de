"""The results of a run without a target: of which scenes, which files, and what the tables are made from."""

from collections.abc import Iterable
from pathlib import Path

from egosplat.pipeline.dag import default_pages
from egosplat.pipeline.scenes import Scene

ABLATIONS = ("baseline", "no_masks", "network_masks")
"""The variants that have rows in the tables, beside the scene itself."""


def default_scenes(scenes: Iterable[Scene]) -> list[Scene]:
    """The scenes of a run without a target: the recording exists or can be made, and none is made by name alone."""
    return [scene for scene in scenes if not scene.by_name and (scene.synthetic or scene.recording.exists())]


def default_results(scene: Scene) -> list[str]:
    """Paths of what such a run makes of a scene, apart from what its survey decides."""
    return [str(scene.results / name) for name in default_pages(scene.config["splats"]["masking"])]


def table_scores(scenes: Iterable[Scene]) -> list[str]:
    """metrics.json of scenes and their ablations; of scenes that are made by name alone, those that exist."""
    scenes = list(scenes)
    own = [path for scene in default_scenes(scenes) for path in _scores(scene)]
    by_name = [path for scene in scenes if scene.by_name for path in _scores(scene) if path.exists()]
    return [str(path) for path in (*own, *by_name)]


def table_pictures(scenes: Iterable[Scene]) -> list[str]:
    """The pictures on the page of the tables."""
    names = ("splats.png", "language.png")
    return [str(scene.results / name) for scene in default_scenes(scenes) for name in names]


def _scores(scene: Scene) -> list[Path]:
    folders = ("", *(f"variants/{name}" for name in ABLATIONS))
    return [scene.results / folder / "metrics.json" for folder in folders]
