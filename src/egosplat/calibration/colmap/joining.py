"""The model of a recording: COLMAP's largest, joined with the others where they share images.

COLMAP aligns two models by the points that both see in their shared images. pycolmap has no function that merges them.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from egosplat.errors import UserError
from egosplat.progress import format_ranges, log

# COLMAP aligns two models by a similarity, estimated from the centers of three shared cameras.
MIN_SHARED = 3
# The error of a joined model, in units of the larger error of its parts. Bundle adjustment absorbs a slightly wrong
# alignment; a wrong one bends the scene and raises the error.
_MAX_ERROR_RATIO = 1.5

# Frames whose longer side is shorter have few features: 16 photographs and a video of 70 frames got half as many poses [px].
_FEW_PIXELS = 512

# A model that is left out, and why.
Left = tuple[pycolmap.Reconstruction, str]


def choose_model(
    models: list[pycolmap.Reconstruction], notes: dict[str, Any], camera_known: bool, min_registered: float
) -> pycolmap.Reconstruction:
    """The largest model of ``reconstruct``, joined with others; log what has no pose, and add numbers to the notes.

    UserError if there is none, or it registers a smaller share of the frames than ``min_registered``.
    """
    compared, verified, parallax = (
        notes[f"pairs_{kind}"] for kind in ("compared", "verified", "with_parallax")
    )
    nothing = (
        f"COLMAP builds no model: of {compared} pairs of frames {verified} show the same scene, and {parallax} of them have "
        "parallax (none where the camera only turns, or the scene is flat): use frames in which it moves sideways, sharper "
        "or larger ones, or another frames.stride"
    )
    if not models:
        raise UserError(nothing)
    model, parts, left = join_models(models, camera_known)
    frames, registered = notes["frames"], {frame for frame, _ in registered_images(model)}
    if parallax == 0 and len(registered) < min_registered * frames:
        raise UserError(nothing)
    if parts > 1:
        log(f"COLMAP: {parts} models share frames and are joined to one of {len(registered)} frames")
    for other, reason in left:
        shown = format_ranges({frame for frame, _ in registered_images(other)})
        log(f"COLMAP: a model of {other.num_reg_images()} frames ({shown}) is left out: it {reason}")
    if left:
        log("COLMAP: to connect the models, record the ways between them, or lower frames.stride")
    if lost := format_ranges(set(range(frames)) - registered):
        log(
            f"COLMAP: {frames - len(registered)} of {frames} frames have no pose and are not used (indices from 0): {lost}; "
            "they are blurred, blank, or share too little with the others"
        )
    if len(registered) < min_registered * frames:
        (camera,) = model.cameras.values()
        side, matching = max(camera.width, camera.height), notes["matching"]
        raise UserError(too_few_message(len(registered), lost, frames, min_registered, matching, side))
    notes["models"] = [len(registered), *(other.num_reg_images() for other, _ in left)]
    notes["models_joined"] = parts
    return model


def registered_images(model: pycolmap.Reconstruction) -> list[tuple[int, pycolmap.Image]]:
    """The frame and the image of all images with a pose, which are named by the numbers of their frames."""
    images = [model.images[number] for number in model.reg_image_ids()]
    return [(int(Path(image.name).stem), image) for image in images]


def join_models(
    models: list[pycolmap.Reconstruction], camera_known: bool
) -> tuple[pycolmap.Reconstruction, int, list[Left]]:
    """Join to the largest as many models of one database as possible; a known camera keeps its focal lengths.

    Returns the joined model, the number of its parts, and the models that could not be joined and have images that it lacks.
    """
    model, *others = sorted(models, key=lambda each: (-each.num_reg_images(), -each.num_points3D()))
    parts, left, index = 1, [], 0
    while index < len(others):
        larger, reason = _join(model, others[index], camera_known)
        if larger is None:
            left.append((others[index], reason))
            index += 1
        else:
            # Models that did not fit before may share images with this one.
            model, parts, left = larger, parts + 1, []
            others, index = others[:index] + others[index + 1 :], 0
    return model, parts, [(other, reason) for other, reason in left if not {*other.images} <= {*model.images}]


def _join(
    model: pycolmap.Reconstruction, other: pycolmap.Reconstruction, camera_known: bool
) -> tuple[pycolmap.Reconstruction | None, str]:
    """The joined model, or None and the reason."""
    shared = len(model.find_common_reg_image_ids(other))
    if shared < MIN_SHARED:
        return None, f"shares {shared} frames with the largest model, and {MIN_SHARED} are needed"
    motion = pycolmap.align_reconstructions_via_reprojections(other, model)
    if motion is None:
        return None, f"does not fit to the largest model, although they share {shared} frames"
    moved, larger = pycolmap.Reconstruction(other), pycolmap.Reconstruction(model)
    moved.transform(motion)
    _add(larger, moved)
    adjust(larger, focal_length=not camera_known)
    limit = _MAX_ERROR_RATIO * max(each.compute_mean_reprojection_error() for each in (model, other))
    if not (error := larger.compute_mean_reprojection_error()) <= limit:
        return None, f"bends the largest model: the joined error is {error:.2f} px, above {limit:.2f} px"
    return larger, ""


def _add(model: pycolmap.Reconstruction, moved: pycolmap.Reconstruction) -> None:
    """Add the images of ``moved`` that ``model`` lacks, with what ``moved`` sees in them."""
    (camera_id,) = model.cameras
    # A finished model lists no image without a pose.
    new = set(moved.images) - set(model.images)
    for image_id in sorted(new):
        image = moved.images[image_id]
        keypoints = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        added = pycolmap.Image(name=image.name, keypoints=keypoints, camera_id=camera_id, image_id=image_id)
        model.add_image_with_trivial_frame(added, image.cam_from_world())
    for _, point in sorted(moved.points3D.items()):
        _add_point(model, point, new)


def _add_point(model: pycolmap.Reconstruction, point: pycolmap.Point3D, new: set[int]) -> None:
    """Add a point's observations in new images: to the model's own point where a shared image sees it."""
    elements = point.track.elements
    added = [element for element in elements if element.image_id in new]
    shared = [element for element in elements if element.image_id not in new]
    own = (model.images[element.image_id].points2D[element.point2D_idx] for element in shared)
    known = next((each.point3D_id for each in own if each.has_point3D()), None)
    if known is not None:
        for element in added:
            model.add_observation(known, element)
    elif len(added) >= 2:
        track = pycolmap.Track()
        for element in added:
            track.add_element(element)
        model.add_point3D(point.xyz, track, point.color)


def adjust(model: pycolmap.Reconstruction, focal_length: bool, distortion: bool = False) -> None:
    """Refine poses, points, and if asked focal length and distortion of a model in place; the principal point is kept."""
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.refine_focal_length = focal_length
    options.refine_extra_params = distortion
    # With more threads, the result depends on their order.
    options.ceres.solver_options.num_threads = 1
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.reg_image_ids():
        config.add_image(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # ``pycolmap.bundle_adjustment`` does the same, and logs past every level.
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()


def too_few_message(
    registered: int, lost: str, frames: int, min_registered: float, matching: str, side: int
) -> str:
    """The error of a model that registers too few frames, whose longer side is ``side`` [px]; it advises."""
    advice = [
        f"set frames.resolution={_FEW_PIXELS}, as {side} px show few details" if side < _FEW_PIXELS else "",
        "add views in between (a smaller frames.stride)",
        "take the part that shows one place (frames.start_s, frames.end_s)",
        "remove blurred and blank frames",
        "set poses.matching=exhaustive" if matching == "sequential" else "",
        "accept the loss by poses.min_registered",
    ]
    advised = ", or ".join(filter(None, advice))
    return (
        f"COLMAP registers {registered} of {frames} frames, and poses.min_registered requires {min_registered:.0%}; "
        f"not registered (indices from 0): {lost}\n{advised[0].upper()}{advised[1:]}"
    )
