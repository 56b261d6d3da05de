"""
Inputs and parameters of pages that are made from several scenes, variants or stages.
"""

from egosplat.pipeline.code_hash import code_hash
from egosplat_rivals.compared import (
    compared_methods,
    compared_variants,
    table_pictures,
    table_scores,
)


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


def get_scenes_of_tradeoff(_):
    """Get metrics.json of the scenes of the joint page, and of their compared variants."""
    wanted = configuration.resolve(config, PRESETS)["tradeoff"]["scenes"]
    named = [find_scene(scenes, *name.split("/")) for name in wanted]
    return [path for scene in named for path in compared_variants(scene)]
