"""
What a run replaces is told before it begins, of a dry run too; it asks nothing and stops nothing.
"""

from egosplat.pipeline.replacements import Asked, replacement_notices
from egosplat.pipeline.process_guards import only_plans


@cache
def scenes_with_preset(preset):
    """The table of scenes as it is read with another preset."""
    chosen = configuration.resolve(dict(config) | {"preset": preset}, presets)
    return {key: scene_with_points(scene) for key, scene in read_scenes(chosen).items()}


def asked_of(scene, variant, goals):
    """What is asked for of a scene or a variant of it."""

    def with_preset(preset):
        base = scenes_with_preset(preset)[scene.dataset, scene.scene].config
        where = f"{scene.dataset}/{scene.scene}"
        return variant_config(base, variant, where) if variant else base

    return Asked(
        folder=scene.results,
        variant=variant,
        goals=goals,
        config=config_of_variant(scene.dataset, scene.scene, variant),
        path_of=lambda stage: Path(
            path_of_variant(stage, scene.dataset, scene.scene, variant)
        ),
        with_preset=with_preset,
    )


def asked_results():
    """What the command line asks for; where it names no scene, of every scene that is there or can be made."""
    if not targets:
        return [
            asked_of(scene, None, tuple(results_of(scene))) for scene in available()
        ]
    names = {}
    for target in targets:
        key = (target.dataset, target.scene, target.variant)
        names.setdefault(key, []).append(target.name)
    return [
        asked_of(find_scene(scenes, dataset, scene), variant, tuple(goals))
        for (dataset, scene, variant), goals in names.items()
    ]


if workflow.is_main_process and (only_plans(sys.argv) or not only_looks(sys.argv)):
    for line in replacement_notices(asked_results()):
        print(f"egosplat: {line}", file=sys.stderr)
