"""Write frames, cameras and points as a data set for other programs: nerfstudio's ``transforms.json``, COLMAP's model."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from PIL import Image

from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, MASKS, POSES, SPLATS, camera_poses, shown_pixels
from egosplat.export.ply import ply_bytes, point_columns
from egosplat.files import atomic_directory
from egosplat.geometry import OPENGL_AXES, Camera, invert
from egosplat.progress import log, track


@dataclass(frozen=True, eq=False)
class DataSet:
    """(F,) int64 frames with (F, 4, 4) float64 poses, OpenCV axes, and (P, 3) float64 points with uint8 colors."""

    camera: Camera
    frame: NDArray[np.int64]
    camera_to_world: NDArray[np.float64]
    xyz: NDArray[np.float64]
    rgb: NDArray[np.uint8]
    origin: str

    def image(self, index: int) -> str:
        """Name of the image of ``frame[index]``."""
        return f"{self.frame[index]:06d}.png"


def export_dataset(scene: Path, output: Path, format: str) -> None:
    """Write a folder with ``images/``, ``masks/`` and cameras.

    Masks are black where a pixel shows no scene or something that moves; there are none if nothing is to be masked.

    Args:
        scene: folder of a scene or variant.
        format: ``nerfstudio`` or ``colmap``.

    Raises:
        UserError: an artifact is missing or damaged.
    """
    *paths, found = locate(scene, "frames", "poses", "splats", "masks")
    frames, poses, splats = map(open_artifact, paths, (FRAMES, POSES, SPLATS))
    masks = open_artifact(found, MASKS) if found.exists() else None
    every = camera_poses(poses, splats)
    height, width = frames.shape("rgb")[1:3]
    known = np.flatnonzero(np.isfinite(every).all(axis=(1, 2)))
    data = DataSet(
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        frame=known,
        camera_to_world=every[known],
        xyz=poses.read("points/xyz"),
        rgb=poses.read("points/rgb"),
        origin=splats.origin,
    )
    with atomic_directory(output) as folder:
        _write_images(folder, data, frames, masks)
        (write_nerfstudio if format == "nerfstudio" else write_colmap)(data, folder)
    log(f"{output}: {len(known)} images, {len(data.xyz)} points")


def _write_images(folder: Path, data: DataSet, frames: Artifact, masks: Artifact | None) -> None:
    (folder / "images").mkdir()
    valid = frames.read("valid")
    hidden = masks is not None or frames.has("masked") or not valid.all()
    if hidden:
        (folder / "masks").mkdir()
    for index, frame in enumerate(track(data.frame, "writing images")):
        Image.fromarray(frames.row("rgb", int(frame))).save(folder / "images" / data.image(index))
        if hidden:
            shown = shown_pixels(frames, int(frame), valid)
            shown = shown if masks is None else shown & ~masks.row("refined", int(frame))
            Image.fromarray(shown.astype(np.uint8) * 255).save(folder / "masks" / data.image(index))


def write_nerfstudio(data: DataSet, folder: Path) -> None:
    """Write ``transforms.json`` (docs.nerf.studio, data conventions) and the points as ``points.ply``."""
    camera, masks = data.camera, (folder / "masks").is_dir()
    document = {
        "camera_model": "PINHOLE",
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "ply_file_path": "points.ply",
        "frames": [
            {
                "file_path": f"images/{data.image(index)}",
                **({"mask_path": f"masks/{data.image(index)}"} if masks else {}),
                "transform_matrix": (pose * OPENGL_AXES).tolist(),
            }
            for index, pose in enumerate(data.camera_to_world)
        ],
    }
    (folder / "transforms.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    (folder / "points.ply").write_bytes(ply_bytes(point_columns(data.xyz, data.rgb), data.origin))


def write_colmap(data: DataSet, folder: Path) -> None:
    """Write a COLMAP model to ``sparse/0``, binary and as text. Its points belong to no images."""
    camera, model = data.camera, pycolmap.Reconstruction()
    lens = {"model": "PINHOLE", "params": [camera.fx, camera.fy, camera.cx, camera.cy]}
    size = {"width": camera.width, "height": camera.height}
    model.add_camera_with_trivial_rig(pycolmap.Camera(camera_id=1, **lens, **size))
    for index, world_to_camera in enumerate(invert(data.camera_to_world)):
        image = pycolmap.Image(name=data.image(index), camera_id=1, image_id=index + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(world_to_camera[:3]))
    for xyz, rgb in zip(data.xyz, data.rgb, strict=True):
        model.add_point3D(xyz, pycolmap.Track(), rgb)
    place = folder / "sparse" / "0"
    place.mkdir(parents=True)
    model.write_text(place)
    # What most programs read first. The text reader that gsplat uses ends at the empty line of an image without points.
    model.write_binary(place)
