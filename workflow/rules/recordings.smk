"""
Where recordings are, and which of their files a stage reads.
"""

from glob import escape, glob

from egosplat.frames.companions import is_annotated


def recording(wildcards):
    """Path of the scene's recording."""
    return str(scene_of(wildcards).recording)


def recording_format(wildcards):
    """How the scene's recording is laid out on disk."""
    return scene_of(wildcards).format


def annotated(wildcards):
    """Whether a plain recording has annotations: without them all of its frames are trained on."""
    scene = scene_of(wildcards)
    return is_annotated(scene.format, scene.recording)


def recording_files(stage):
    """A function of the wildcards: the files of the recording that a stage reads, so that a change is seen.

    A synthetic recording is one folder, made by a rule. Of a real one, what exists is watched: the stage
    itself says best what is missing.
    """

    def files_of_scene(wildcards):
        scene = scene_of(wildcards)
        if scene.synthetic:
            return [str(scene.recording)]
        check_recording(scene)
        # What belongs to a video lies beside it: clip.mp4.camera.json.
        within = "/" if scene.recording.is_dir() else "."
        found = [
            path
            for pattern in WATCHED[scene.format][stage]
            for path in glob(escape(str(scene.recording)) + within + pattern)
        ]
        if not scene.recording.is_dir():
            found.append(str(scene.recording))
        # The folder itself not as "folder/.", which Snakemake takes for missing. Braces it takes for its own.
        return sorted(
            os.path.normpath(path) for path in found if not set("{}") & set(path)
        )

    return files_of_scene


WATCHED = {
    "adt": {
        "frames": ["video.vrs", "metadata.json"],
        "annotations": ["segmentations*.vrs", "instances.json"],
        "poses": ["aria_trajectory.csv", "mps/slam/*.csv*"],
    },
    "hoi4d": {
        "frames": ["align_rgb/image.mp4"],
        "annotations": ["2Dseg/*mask"],
        "poses": [],
    },
    # A folder's own time tells of files that come and go, not of one that is written anew in its place.
    "plain": {
        "frames": [".", "camera.json", "valid.png"],
        "annotations": ["annotations", "annotations/*"],
        "poses": [],
    },
}
"""Of each format, what a stage reads."""
