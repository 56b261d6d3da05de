"""Results of a run without a target, and inputs of the tables."""

from collections.abc import Iterable
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.dag import default_pages
from egosplat.pipeline.scenes import Scene

# Variants that have rows in the tables, in addition to the scene itself.
ABLATIONS = ("baseline", "no_masks", "network_masks")


def default_scenes(scenes: Iterable[Scene]) -> list[Scene]:
    """Get the scenes of a run without a target: those with a recording, and synthetic ones that need not be named."""
    return [scene for scene in scenes if not (scene.by_name or scene.lacks_recording)]


def default_results(scene: Scene) -> list[str]:
    """Get the paths that such a run makes for a scene, except those that its survey decides."""
    return [str(scene.results / name) for name in default_pages(scene.config)]


def table_scores(scenes: Iterable[Scene]) -> list[str]:
    """Get metrics.json of scenes, their ablations and other methods; of scenes that must be named, only existing files."""
    scenes = list(scenes)
    own = [path for scene in default_scenes(scenes) for path in _scores(scene)]
    by_name = [path for scene in scenes if scene.by_name for path in _scores(scene) if path.exists()]
    return [str(path) for path in (*own, *by_name)]


def table_pictures(scenes: Iterable[Scene]) -> list[str]:
    """Get the figures on the tables page."""
    return [
        str(scene.results / name)
        for scene in default_scenes(scenes)
        for name in ("splats.png", "language.png", *(["methods.png"] if compared_methods(scene) else []))
    ]


def compared_methods(scene: Scene) -> list[str]:
    """Get metrics.json of a scene and of its variants for other methods; empty without any."""
    variants = scene.config["tables"]["methods"]
    folders = ["", *(f"variants/{name}" for name in variants)] if variants else []
    return [str(scene.results / folder / "metrics.json") for folder in folders]


def maps_of(scene: Scene, method: str) -> Path:
    """Get the path of a method's relevancy maps of a scene (UserError: no folder of maps is configured)."""
    folder = scene.config["tables"]["maps"]
    if folder is None:
        raise UserError(
            f"{scene.name}: no folder of relevancy maps is configured; set tables.maps, as in "
            f"--config 'tables={{maps: FOLDER}}' with FOLDER/{scene.name}/{method}.zarr"
        )
    return Path(folder) / scene.dataset / scene.scene / f"{method}.zarr"


def _scores(scene: Scene) -> list[Path]:
    keys = scene.config["tables"]
    folders = ["", *(f"variants/{name}" for name in (*ABLATIONS, *keys["methods"]))]
    if keys["maps"] is not None:
        folders += [f"methods/{path.stem}" for path in sorted(maps_of(scene, "*").parent.glob("*.zarr"))]
    return [scene.results / folder / "metrics.json" for folder in folders]
