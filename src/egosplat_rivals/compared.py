"""The scores that pages of several scenes and variants compare. The workflow asks for them; it needs no other module here."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from egosplat.pipeline.scenes import Scene, default_scenes
from egosplat.pipeline.variants import owner, reaches, variant_config, variant_folder

# Datasets that the tables show, and their names there.
NAMES = {"adt": "ADT", "hoi4d": "HOI4D"}

# Variants that have rows in the tables, in addition to the scene itself.
ABLATIONS = ("baseline", "no_masks", "network_masks")


def table_scores(scenes: Iterable[Scene]) -> list[str]:
    """Get metrics.json of scenes, their ablations and other methods; of scenes that must be named, only existing files."""
    scenes = [scene for scene in scenes if scene.dataset in NAMES]
    own = [path for scene in default_scenes(scenes) for path in _table_scores_of(scene)]
    by_name = [path for scene in scenes if scene.by_name for path in _table_scores_of(scene)]
    return [*own, *(path for path in by_name if Path(path).exists())]


def table_pictures(scenes: Iterable[Scene]) -> list[str]:
    """Get the figures on the tables page."""
    return [
        str(scene.results / name)
        for scene in default_scenes(scene for scene in scenes if scene.dataset in NAMES)
        for name in ("splats.png", *(["methods.png"] if compared_methods(scene) else []))
    ]


def compared_methods(scene: Scene) -> list[str]:
    """Get metrics.json of a scene and of its variants for other methods, each as it is asked first; empty without any."""
    # What asks the codes of another variant has no codes of its own.
    names = scene.config["tables"]["methods"]
    methods = [name for name in names if owner("language", scene.config, name, scene.name) == name]
    return _scores(scene, [None, *methods]) if methods else []


def compared_variants(scene: Scene) -> list[str]:
    """Get metrics.json of a scene and of the variants in ``tradeoff.variants`` that change its scores (UserError: there is no such one)."""
    configs = {
        name: variant_config(scene.config, name, scene.name) for name in scene.config["tradeoff"]["variants"]
    }
    changed = [name for name, own in configs.items() if reaches("metrics", scene.config, own)]
    return _scores(scene, [None, *changed])


def _table_scores_of(scene: Scene) -> list[str]:
    return _scores(scene, [None, *ABLATIONS, *scene.config["tables"]["methods"]])


def _scores(scene: Scene, variants: Sequence[str | None]) -> list[str]:
    return [f"{scene.results}/{variant_folder(name)}metrics.json" for name in variants]
