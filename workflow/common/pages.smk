"""
Inputs and parameters of pages that are made from several scenes, variants or stages.
"""

import json

from egosplat.pipeline.code_hash import code_hash
from egosplat.pipeline.results import compared_methods, table_pictures, table_scores


def get_picture_flags(_):
    """Get the figures of the tables page as command line flags."""
    return " ".join(
        f"--picture {shlex.quote(path)}" for path in table_pictures(scenes.values())
    )


def get_story_files(wildcards):
    """Get the outputs that the story of a scene or variant tells of."""
    config = config_of(wildcards)
    annotated = is_recording_annotated(wildcards)
    surveyed = dag.is_surveyed(config)
    stages = dag.story_stages(decided_config(wildcards), annotated, surveyed)
    return [path_named(stage, *names_of(wildcards)) for stage in stages]


@cache
def points_named(dataset, scene):
    """Get the points of a scene: their settings, and metrics.json of each of their runs."""
    return measured_points(find_scene(scenes, dataset, scene))


def get_points_metrics(wildcards):
    """Get metrics.json of all runs."""
    points = points_named(wildcards.dataset, wildcards.scene)
    return [path for point in points for path in point["metrics"]]


def get_points_flag(wildcards):
    """Get the points as one command line argument."""
    return shlex.quote(json.dumps(points_named(wildcards.dataset, wildcards.scene)))


def get_scenes_of_tradeoff(_):
    """Get tradeoff.json of each scene of the joint page."""
    wanted = configuration.resolve(config, PRESETS)["tradeoff"]["scenes"]
    found = [find_scene(scenes, *name.split("/")) for name in wanted]
    return [f"{scene.results}/tradeoff/tradeoff.json" for scene in found]
