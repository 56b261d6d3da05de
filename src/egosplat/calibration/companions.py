"""Paths of the files that accompany a plain recording. The workflow imports this module, so it stays light."""

from pathlib import Path

# The files with known poses, by the value of ``frames.known_poses``.
KNOWN_POSES = {"colmap": "colmap", "transforms": "transforms.json"}


def companion_path(source: Path, name: str) -> Path:
    """Path of a file that accompanies a plain recording.

    It lies in the image folder, or next to the video as ``clip.mp4.<name>``.
    """
    return source / name if source.is_dir() else source.with_name(f"{source.name}.{name}")
