"""
What is made of every scene where nothing else is asked for.

snakemake --report shows what is there of it: it need not wait for the scenes that are not finished.
"""

from egosplat.pipeline.process_guards import only_reports

REPORTS = only_reports(sys.argv)


def results_of_scenes(_):
    """The pictures and scores of every scene whose recording is there or can be made."""
    wanted = [
        str(scene.results / name) for scene in available() for name in results_of(scene)
    ]
    found = reported(wanted)
    if REPORTS and not found:
        sys.exit(
            "egosplat: no scene has results to report; make some: snakemake --cores 2 results/DATASET/SCENE/metrics.json"
        )
    return found


def surveyed_results(_):
    """Of the scenes whose survey decides what is masked: the picture of what moves, where something does."""
    asked = [scene for scene in available() if masks_by_survey(scene.config)]
    return reported(
        [
            str(scene.results / "transient.png")
            for scene in asked
            if REPORTS or survey_masks(scene) == "refined"
        ]
    )


def reported(paths):
    """The paths; for a report those that are there."""
    return [path for path in paths if os.path.exists(path)] if REPORTS else paths


def survey_masks(scene):
    """What a scene's survey says of masking."""
    return survey_of_variant(scene.dataset, scene.scene, None)["motion"]["masking"]


def available():
    """The scenes whose recording is there or can be made, but for those that are made by name alone."""
    return [
        scene
        for scene in scenes.values()
        if not scene.by_name and (scene.synthetic or scene.recording.exists())
    ]


def results_of(scene):
    """Of one scene; what moves is shown where it is masked by instances."""
    names = ["contact_sheet.png", "segments.png", "crops.png"]
    if scene.config["splats"]["masking"] == "refined":
        names.append("transient.png")
    return [*names, "splats.png", "language.png", "metrics.json", "queries.png"]
