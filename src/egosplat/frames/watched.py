"""List the files of a recording that a stage reads, as inputs of its rule: a change of one reruns the stage."""

import os
from glob import escape, glob
from pathlib import Path

# The points of a transforms.json are in a PLY file beside it.
_KNOWN_POSES = ["transforms.json", "colmap", "colmap/*.bin", "colmap/*.txt", "*.ply"]

# By format and stage: patterns inside the recording's folder, or after a video's name.
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
    # A folder's modification time does not change when a file in it is replaced, so the files are listed too.
    "plain": {
        "frames": [".", "camera.json", "valid.png", *_KNOWN_POSES],
        "annotations": ["annotations", "annotations/*"],
        "poses": _KNOWN_POSES,
    },
}


def watched_files(format: str, recording: Path, stage: str) -> list[str]:
    """The existing files of a recording that a stage reads, sorted. The stage itself reports missing ones.

    Args:
        format: ``adt``, ``hoi4d`` or ``plain``.
        recording: folder, or video file with companion files (``clip.mp4.camera.json``).
        stage: ``frames``, ``annotations`` or ``poses``.
    """
    is_folder = recording.is_dir()
    separator = "/" if is_folder else "."
    patterns = [escape(str(recording)) + separator + pattern for pattern in _WATCHED[format][stage]]
    found = [path for pattern in patterns for path in glob(pattern)]
    if not is_folder:
        found.append(str(recording))
    # Snakemake reads braces as wildcards and does not find "folder/.".
    return sorted(os.path.normpath(path) for path in found if not set("{}") & set(path))
