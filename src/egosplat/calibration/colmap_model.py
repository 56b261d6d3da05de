"""Read a COLMAP model folder: ``cameras``, ``images`` and ``points3D``, all as .bin or all as .txt."""

import struct
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from egosplat.arrays import Array, Bytes, Ints
from egosplat.calibration.files import MODEL_FILES, MODEL_SUFFIXES, model_files, next_image
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import invert, make_pose


@dataclass(frozen=True)
class Contents:
    """Calibration, poses and points from one file or folder, whichever its format.

    Attributes:
        cameras: of N full-size pictures.
        names: of the pictures, as the file spells them.
        camera_to_world: (N, 4, 4) float64, OpenCV axes, in the file's own world and unit.
        points, point_rgb: (P, 3) float64 in the same world, (P, 3) uint8.
        point_views, point_error_px: (P,) int64 number of pictures that see each point, and (P,) float64 mean reprojection error
            [px of the full-size pictures]; 0 where the file does not say.
        masks: the mask of each picture, black where it is not to be used, or None; empty if there is none.
        unread: keys of the file that do not count.
        notes: further facts, as plain JSON.
    """

    cameras: list[Lens]
    names: list[str]
    camera_to_world: Array
    points: Array
    point_rgb: Bytes
    point_views: Ints
    point_error_px: Array
    masks: list[Path | None] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def lenses(self) -> list[Lens]:
        """The cameras without repetition."""
        return list(dict.fromkeys(self.cameras))

    @property
    def lens_of(self) -> Ints:
        """(N,) the index of each picture's lens."""
        index_of = {lens: index for index, lens in enumerate(self.lenses)}
        return np.array([index_of[camera] for camera in self.cameras], np.int64)


def read_model(folder: Path) -> Contents:
    """Read the cameras, the poses and the points of a model; UserError if a file is missing or damaged."""
    files = model_files(folder)
    suffix = files[0].suffix if files else MODEL_SUFFIXES[0]
    if missing := [name for name in MODEL_FILES if folder / f"{name}{suffix}" not in files]:
        raise UserError(
            f"{folder}: has no {', '.join(f'{name}{suffix}' for name in missing)}. A COLMAP model has cameras, images and "
            "points3D, all .bin or all .txt. Export it again, or set frames.known_poses=none."
        )
    for file in files:
        if suffix == ".bin":
            _check_whole(file)
        elif file.stem == "images":
            _check_names(file)
    # COLMAP reads every file that it finds; here the three that are checked.
    with tempfile.TemporaryDirectory(prefix="egosplat-model-") as scratch:
        for file in files:
            (Path(scratch) / file.name).symlink_to(file.absolute())
        try:
            model = pycolmap.Reconstruction(scratch)
            images = sorted((one for one in model.images.values() if one.has_pose), key=lambda one: one.name)
        except (ValueError, IndexError, RuntimeError, OSError) as error:
            reason = str(error).replace(f"{scratch}/", "").partition("\n")[0][-200:]
            raise UserError(f"{folder}: not a readable COLMAP model ({reason}). Export it again.") from error
    if not images:
        raise UserError(f"{folder}: has no image with a pose.")
    motions = [image.cam_from_world() for image in images]
    world_to_camera = np.stack([motion.matrix() for motion in motions])
    # pycolmap takes a quaternion of zeros, or of a scale alone, for no rotation; few digits are no scale.
    length = np.array([np.linalg.norm(motion.rotation.quat) for motion in motions])[:, None, None]
    world_to_camera[:, :, :3] *= np.where(abs(length - 1) < 1e-3, 1.0, length)
    points = [point for _, point in sorted(model.points3D.items())]
    return Contents(
        cameras=[Lens.of_colmap(model.cameras[image.camera_id]) for image in images],
        names=[image.name for image in images],
        camera_to_world=invert(make_pose(world_to_camera[:, :, :3], world_to_camera[:, :, 3])),
        points=np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        point_rgb=np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        point_views=np.array([point.track.length() for point in points], np.int64),
        point_error_px=np.array([max(point.error, 0.0) for point in points], np.float64),
    )


def _check_names(path: Path) -> None:
    """Raise UserError if a name has a space, where COLMAP ends it, or an image has no line of points, which may be empty."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            if (words := line.split()) and words[0][0] != "#":
                if words[9:] and len(next(lines, "none").split()) % 3:
                    raise UserError(f"{path}: {words[9]}: the next line must have its points, or be empty.")
                if words[10:]:
                    raise UserError(f"{path}: {' '.join(words[9:])}: no spaces in names. Export it as .bin.")


def _check_whole(path: Path) -> None:
    """Raise UserError unless a binary file ends where its last record ends: COLMAP would wait or invent values."""
    content, position = path.read_bytes(), 8
    try:
        for _ in range(*struct.unpack_from("<Q", content)):
            if path.stem == "cameras":
                (model,) = struct.unpack_from("<i", content, position + 4)
                camera = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId(model), 1.0, 1, 1)
                position += 24 + 8 * len(camera.params)
            elif path.stem == "points3D":
                position += 51 + 8 * struct.unpack_from("<Q", content, position + 43)[0]
            else:
                position = next_image(content, position)[1]
    except (struct.error, ValueError, OverflowError):
        position = -1
    if position != len(content):
        raise UserError(f"{path}: damaged or incomplete ({len(content)} bytes). Copy it again.")
