"""Write frames, cameras and points as a data set for other programs: nerfstudio's ``transforms.json``, COLMAP's model."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pycolmap
from PIL import Image

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, MASKS, POSES, SPLATS, camera_poses, shown_pixels
from egosplat.export.gaussians import point_columns, write_ply
from egosplat.files import atomic_directory
from egosplat.geometry import OPENGL_AXES, Array, Camera, invert, known_poses
from egosplat.progress import log, track


def export_cameras(scene: Path, output: Path, format: str) -> None:
    """Write a folder with ``images/``, ``masks/`` and cameras of a scene or variant, in the ``nerfstudio`` or ``colmap`` format.

    Masks are black where a pixel shows no scene or something that moves; there are none if nothing is to be masked. UserError: an
    artifact is missing, damaged or of another scene."""
    *paths, moving = locate(scene, "frames", "poses", "splats", "masks")
    frames, poses, splats = map(open_artifact, paths, (FRAMES, POSES, SPLATS))
    check_made_from(poses, frames)
    check_made_from(splats, frames, poses)
    masks = open_artifact(moving, MASKS) if moving.exists() else None
    # One of other frames is left of earlier keys, with which something moved.
    masks = None if masks is None or masks.provenance["inputs"].get("frames.zarr") != frames.digest else masks
    camera_to_world, valid = camera_poses(poses, splats), frames.read("valid")
    height, width = valid.shape
    camera = Camera.from_matrix(poses.read("intrinsics"), width, height)
    known, names = known_poses(camera_to_world), []
    hidden = masks is not None or frames.has("masked") or not valid.all()
    xyz, rgb = poses.read("points/xyz"), poses.read("points/rgb")
    with atomic_directory(output) as folder:
        for name in ("images", "masks") if hidden else ("images",):
            (folder / name).mkdir()
        for frame in track(known.tolist(), "writing images"):
            names.append(f"{frame:06d}.png")
            Image.fromarray(frames.row("rgb", frame)).save(folder / "images" / names[-1])
            if hidden:
                shown = shown_pixels(frames, frame, valid)
                shown = shown if masks is None else shown & ~masks.row("refined", frame)
                Image.fromarray(shown.astype(np.uint8) * 255).save(folder / "masks" / names[-1])
        if format == "nerfstudio":
            _write_transforms(folder / "transforms.json", camera, names, camera_to_world[known], hidden)
            write_ply(folder / "points.ply", point_columns(xyz, rgb), splats.origin)
        else:
            _write_model(folder / "sparse" / "0", camera, names, camera_to_world[known], xyz, rgb)
    log(f"{output}: {len(known)} images, {len(xyz)} points")


def _write_transforms(path: Path, camera: Camera, names: list[str], poses: Array, masks: bool) -> None:
    """Write ``transforms.json`` (docs.nerf.studio, data conventions), which names the points."""
    frames = [
        {
            "file_path": f"images/{name}",
            **({"mask_path": f"masks/{name}"} if masks else {}),
            "transform_matrix": (pose * OPENGL_AXES).tolist(),
        }
        for name, pose in zip(names, poses, strict=True)
    ]
    short = {"width": "w", "height": "h", "fx": "fl_x", "fy": "fl_y", "cx": "cx", "cy": "cy"}
    lens = {short[name]: value for name, value in asdict(camera).items()}
    document = {"camera_model": "PINHOLE", **lens, "ply_file_path": "points.ply", "frames": frames}
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _write_model(
    path: Path, camera: Camera, names: list[str], camera_to_world: Array, xyz: Array, rgb: Array
) -> None:
    """Write a COLMAP model, binary and as text. Its points belong to no images."""
    model = pycolmap.Reconstruction()
    lens = {"model": "PINHOLE", "params": [camera.fx, camera.fy, camera.cx, camera.cy]}
    size = {"width": camera.width, "height": camera.height}
    model.add_camera_with_trivial_rig(pycolmap.Camera(camera_id=1, **lens, **size))
    for number, (name, world_to_camera) in enumerate(zip(names, invert(camera_to_world), strict=True), 1):
        image = pycolmap.Image(name=name, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(world_to_camera[:3]))
    for place, color in zip(xyz, rgb, strict=True):
        model.add_point3D(place, pycolmap.Track(), color)
    path.mkdir(parents=True)
    model.write_text(path)
    # What most programs read first. The text reader that gsplat uses ends at the empty line of an image without points.
    model.write_binary(path)
