"""Whether pictures ask for radial distortion: COLMAP's SIMPLE_PINHOLE and RADIAL, fitted to the same observations, are compared.

Two more parameters always lower the squared reprojection error, so two questions decide:

- Is it more than chance? A paired t-test over the pictures asks whether the mean drop is above 0: errors inside a picture
  depend on each other, and pictures hardly do.
- Does it matter? Between the two cameras some feature must move by more than the median reprojection error, its own precision, and
  the features must reach towards the corners: outside of them a polynomial may be far off.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy import stats

from egosplat.calibration.colmap.choosing import adjust
from egosplat.calibration.colmap.mapping import reconstruct
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.progress import log

# All pairs of them are matched, so that the time does not grow with the recording.
MAX_PICTURES = 30
# Fewer give a t-test that only a strong lens passes, and a lens that is hardly known.
MIN_PICTURES = 8
# Probability with which a lens without distortion is called distorted.
FALSE_ALARM = 0.001
# Within 70 % of the way to the corners lie 3/4 of a picture's pixels.
MIN_REACH = 0.7
# Pictures that are too far apart to match are tried again with this fraction of their distance.
_CLOSER = 8

ReadFrames = Callable[[NDArray[np.int64]], Iterable[NDArray[np.uint8]]]
ShownIn = Callable[[int], NDArray[np.bool_]]
# As plain JSON: the root mean square reprojection errors ``pinhole_px`` and ``radial_px``, and the median ``median_px`` of the latter;
# ``chance`` of such a drop without distortion; ``bend_px``, the largest distance between the two cameras at a feature; ``reach``, the
# distance from the center within which 99 % of the features lie, in half diagonals; and the verdict, ``distorted``.
Evidence = dict[str, Any]


def lens_of_frames(
    read: ReadFrames, count: int, valid: NDArray[np.bool_], camera: Camera, shown: ShownIn | None = None
) -> Lens | None:
    """The lens that frames are rectified from, if they ask for it; None if they do not (OSError: the disk is full).

    ``read`` yields the (H, W, 3) uint8 frames of increasing indices, of ``count``; ``valid`` and ``shown(index)`` are the (H, W) bool
    pixels that show the scene in all and in each; ``camera`` is a guess.
    """
    log("lens: looking for distortion in the frames (frames.lens=pinhole skips this)")
    try:
        lens, evidence = _estimate(read, count, valid, camera, shown)
        if evidence["distorted"]:
            lens.check("the estimated lens")
    except UserError as error:
        reason = str(error).partition("\n")[0]
        log(f"lens: taken as a pinhole camera, because it cannot be estimated: {reason}")
        return None
    verdict = "radial distortion" if evidence["distorted"] else "no distortion to rectify"
    log(
        "lens: {verdict}: reprojection error {pinhole_px:.3f} px without it, {radial_px:.3f} px with it (probability by "
        "chance {chance:.1g}); it moves features by up to {bend_px:.2f} px, which are precise to {median_px:.2f} px and "
        "reach {reach:.0%} of the way to the corners".format(verdict=verdict, **evidence)
    )
    return lens if evidence["distorted"] else None


def _estimate(
    read: ReadFrames, count: int, valid: NDArray[np.bool_], camera: Camera, shown: ShownIn | None
) -> tuple[Lens, Evidence]:
    """A radial lens from some frames, and whether they ask for it; UserError without a model of ``MIN_PICTURES`` of them."""
    registered = 0
    radial = Lens("RADIAL", camera.width, camera.height, (camera.fx, camera.cx, camera.cy, 0.0, 0.0))
    for frames in choices(count) if count >= MIN_PICTURES else ():
        masks = None if shown is None else map(shown, frames.tolist())
        models, _ = reconstruct("egosplat-lens-", read(frames), valid, masks, radial.colmap(), "exhaustive")
        for model in sorted(models, key=lambda model: -model.num_reg_images())[:1]:
            registered = model.num_reg_images()
            if 2 * registered >= len(frames) and registered >= MIN_PICTURES:
                return compare(model)
    raise UserError(f"{registered} frames can be oriented to each other, and {MIN_PICTURES} are needed")


def choices(count: int) -> Iterator[NDArray[np.int64]]:
    """Up to ``MAX_PICTURES`` frames in the middle of the recording, from far apart to neighbors."""
    step = max(1, -(-count // MAX_PICTURES))
    while True:
        chosen = min(MAX_PICTURES, -(-count // step))
        first = (count - 1 - (chosen - 1) * step) // 2
        yield first + step * np.arange(chosen, dtype=np.int64)
        if step == 1:
            return
        step = max(1, step // _CLOSER)


def compare(model: pycolmap.Reconstruction) -> tuple[Lens, Evidence]:
    """Fit a pinhole and a radial camera to a model of a RADIAL one, and compare them picture by picture."""
    pinhole, without = _fitted(model, "SIMPLE_PINHOLE")
    radial, with_it = _fitted(model, "RADIAL")
    drops = np.array([without[image].mean() - with_it[image].mean() for image in sorted(without)])
    spread = drops.std(ddof=1)
    # Equal drops have no spread; then they are no chance, unless they are 0.
    score = drops.mean() * np.sqrt(len(drops)) / spread if spread > 0 else np.inf * np.sign(drops.mean())
    chance = float(stats.t.sf(np.nan_to_num(score), len(drops) - 1))
    images = [model.images[number] for number in model.reg_image_ids()]
    features = np.array([point.xy for image in images for point in image.points2D if point.has_point3D()])
    f, cx, cy = map(float, pinhole.params)
    rays = radial.cam_from_img(features)
    assert rays is not None
    bend = np.linalg.norm(rays * [f, f] + [cx, cy] - features, axis=1).max()
    reach = float(np.quantile(np.linalg.norm(features - [cx, cy], axis=1) / np.hypot(cx, cy), 0.99))
    squares = np.concatenate(list(with_it.values()))
    median = float(np.sqrt(np.median(squares)))
    return Lens.of_colmap(radial), {
        "pinhole_px": float(np.sqrt(np.concatenate(list(without.values())).mean())),
        "radial_px": float(np.sqrt(squares.mean())),
        "median_px": median,
        "chance": chance,
        "bend_px": float(bend),
        "reach": reach,
        "distorted": bool(chance < FALSE_ALARM and bend > median and reach >= MIN_REACH),
    }


def _fitted(model: pycolmap.Reconstruction, name: str) -> tuple[pycolmap.Camera, dict[int, NDArray]]:
    """The camera after bundle adjustment with a camera model, and the squared errors [px^2] of each image."""
    fitted = pycolmap.Reconstruction(model)
    (camera,) = fitted.cameras.values()
    params = list(camera.params)
    camera.model = getattr(pycolmap.CameraModelId, name)
    camera.params = params[:3] if name == "SIMPLE_PINHOLE" else params
    adjust(fitted)
    squares = {}
    for number in fitted.reg_image_ids():
        image = fitted.images[number]
        seen = [point for point in image.points2D if point.has_point3D()]
        world = np.array([fitted.points3D[point.point3D_id].xyz for point in seen]).reshape(-1, 3)
        pose = image.cam_from_world().matrix()
        shown = camera.img_from_cam(world @ pose[:, :3].T + pose[:, 3])
        squares[number] = ((shown - np.array([point.xy for point in seen]).reshape(-1, 2)) ** 2).sum(axis=1)
    return camera, squares
