"""Recordings of a test: copies with some of their files, and models as COLMAP makes them."""

import shutil
from collections.abc import Iterable
from pathlib import Path

import pycolmap

from egosplat.calibration.files import opened_files


def copy_files(files: Iterable[Path], root: Path, target: Path) -> Path:
    """Copy files below ``root`` to the same places below ``target``, and return it."""
    for file in files:
        place = target / file.relative_to(root)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    return target


def opened(stage: str, format: str, recording: Path, known: str = "auto", **poses: str) -> list[Path]:
    """The files of a recording that a stage opens, by ``frames.known_poses`` and keys of ``poses``."""
    keys = {"method": "auto", "trajectory": "closed_loop"} | poses
    return opened_files(stage, format, recording, {"frames": {"known_poses": known}, "poses": keys})


def synthesized(
    seed: int, frames: int, points: int, noise: float = 0.0, **camera: object
) -> pycolmap.Reconstruction:
    """A model of pictures of one camera, whose points are located to ``noise`` px; ``camera``: options of pycolmap's."""
    pycolmap.set_random_seed(seed)
    about = {"num_rigs": 1, "num_cameras_per_rig": 1, "num_frames_per_rig": frames, "num_points3D": points}
    model = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(**about | camera))
    if noise:
        pycolmap.synthesize_noise(pycolmap.SyntheticNoiseOptions(point2D_stddev=noise), model)
    return model
