"""
What is made of every scene where nothing else is asked for.
"""


def results_of_scenes(_):
    """The pictures and scores of every scene whose recording is there or can be made."""
    return [
        str(scene.results / name) for scene in available() for name in results_of(scene)
    ]


def surveyed_results(_):
    """Of the scenes whose survey decides what is masked: the picture of what moves, where something does."""
    asked = [scene for scene in available() if masks_by_survey(scene.config)]
    return [
        str(scene.results / "transient.png")
        for scene in asked
        if survey_masks(scene) == "refined"
    ]


def survey_masks(scene):
    """What a scene's survey says of masking."""
    return survey_of_variant(scene.dataset, scene.scene, None)["motion"]["masking"]


def available():
    """The scenes whose recording is there or can be made."""
    return [
        scene
        for scene in scenes.values()
        if scene.synthetic or scene.recording.exists()
    ]


def results_of(scene):
    """Of one scene; what moves is shown where it is masked by instances."""
    names = ["contact_sheet.png", "segments.png", "crops.png"]
    if scene.config["splats"]["masking"] == "refined":
        names.append("transient.png")
    return [*names, "splats.png", "language.png", "metrics.json", "queries.png"]
