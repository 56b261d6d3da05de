"""The files of a recording that a stage reads: inputs of its rule, so that a change of one is seen."""

import os
from glob import escape, glob
from pathlib import Path

_WATCHED = {
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
    # A folder's own time shows that files come or go, not that one is replaced: the files are watched too.
    "plain": {
        "frames": [".", "camera.json", "valid.png"],
        "annotations": ["annotations", "annotations/*"],
        "poses": [],
    },
}
"""By format of the recording and stage: patterns below the recording's folder, or after a video's name."""


def watched_files(format: str, recording: Path, stage: str) -> list[str]:
    """The files of a recording that a stage reads and that exist, sorted; the stage reports a missing one.

    Args:
        format: ``adt``, ``hoi4d`` or ``plain``.
        recording: folder, or video file with the files beside it (``clip.mp4.camera.json``).
        stage: ``frames``, ``annotations`` or ``poses``.
    """
    is_folder = recording.is_dir()
    within = "/" if is_folder else "."
    patterns = [escape(str(recording)) + within + pattern for pattern in _WATCHED[format][stage]]
    found = [path for pattern in patterns for path in glob(pattern)]
    if not is_folder:
        found.append(str(recording))
    # Snakemake takes braces for wildcards, and "folder/." for missing.
    return sorted(os.path.normpath(path) for path in found if not set("{}") & set(path))
