"""Join COLMAP's models of one recording where they share images.

COLMAP aligns two models by the points that both see in their shared images. pycolmap has no function that merges them.
"""

from dataclasses import dataclass

import numpy as np
import pycolmap

# COLMAP aligns two models by a similarity, estimated from the centers of three shared cameras.
MIN_SHARED = 3
# The error of a joined model, in units of the larger error of its parts. Bundle adjustment absorbs a slightly wrong
# alignment; a wrong one bends the scene and raises the error.
_MAX_ERROR_RATIO = 1.5


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


@dataclass(frozen=True)
class Joined:
    """The largest model, with the images of the ``parts - 1`` models that fit to it.

    ``others`` could not be joined, for ``reasons``, and have images that ``model`` lacks, the largest first.
    """

    model: pycolmap.Reconstruction
    parts: int
    others: list[pycolmap.Reconstruction]
    reasons: list[str]


def join_models(models: list[pycolmap.Reconstruction], camera_known: bool) -> Joined:
    """Join to the largest as many models of one database as possible; a known camera keeps its focal lengths."""
    model, *others = sorted(models, key=lambda one: (-one.num_reg_images(), -one.num_points3D()))
    parts, reasons = 1, [""] * len(others)
    joined = True
    while joined and others:
        joined = False
        for index, other in enumerate(others):
            larger, reasons[index] = _join(model, other, camera_known)
            if larger is not None:
                model, parts, joined = larger, parts + 1, True
                del others[index], reasons[index]
                break
    inside = set(model.reg_image_ids())
    left = [index for index, other in enumerate(others) if not set(other.reg_image_ids()) <= inside]
    return Joined(model, parts, [others[index] for index in left], [reasons[index] for index in left])


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
    moved = pycolmap.Reconstruction(other)
    moved.transform(motion)
    larger = pycolmap.Reconstruction(model)
    _add(larger, moved)
    adjust(larger, focal_length=not camera_known)
    limit = _MAX_ERROR_RATIO * max(one.compute_mean_reprojection_error() for one in (model, other))
    if not (error := larger.compute_mean_reprojection_error()) <= limit:
        return None, f"bends the largest model: the joined error is {error:.2f} px, above {limit:.2f} px"
    return larger, ""


def _add(model: pycolmap.Reconstruction, moved: pycolmap.Reconstruction) -> None:
    """Add the images of ``moved`` that ``model`` lacks, with what ``moved`` sees in them."""
    (camera_id,) = model.cameras
    new = sorted(set(moved.reg_image_ids()) - set(model.reg_image_ids()))
    for image_id in new:
        image = moved.images[image_id]
        keypoints = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        # An unregistered image of the model has no pose; it is replaced.
        if model.exists_image(image_id):
            model.images[image_id].frame.rig_from_world = image.cam_from_world()
            model.register_frame(model.images[image_id].frame_id)
        else:
            added = pycolmap.Image(
                name=image.name, keypoints=keypoints, camera_id=camera_id, image_id=image_id
            )
            model.add_image_with_trivial_frame(added, image.cam_from_world())
    for _, point in sorted(moved.points3D.items()):
        _add_point(model, point, set(new))


def _add_point(model: pycolmap.Reconstruction, point: pycolmap.Point3D, new: set[int]) -> None:
    """Add a point's observations in new images: to the model's own point where a shared image sees it."""
    seen = [(element.image_id, element.point2D_idx) for element in point.track.elements]
    shared = [model.images[image].points2D[index] for image, index in seen if image not in new]
    known = next((one.point3D_id for one in shared if one.has_point3D()), None)
    added = [pycolmap.TrackElement(image, index) for image, index in seen if image in new]
    if known is not None:
        for element in added:
            model.add_observation(known, element)
    elif len(added) >= 2:
        track = pycolmap.Track()
        for element in added:
            track.add_element(element)
        model.add_point3D(point.xyz, track, point.color)
