"""The model of a recording: COLMAP's largest, and what to do about the rest."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from egosplat.errors import UserError
from egosplat.progress import format_ranges, log

# Frames whose longer side is shorter have few features: 16 photographs and a video of 70 frames got half as many poses [px].
_FEW_PIXELS = 512


def choose_model(
    models: list[pycolmap.Reconstruction],
    notes: dict[str, Any],
    min_registered: float,
    frame_keys: Mapping[str, Any],
) -> pycolmap.Reconstruction:
    """The largest model of ``reconstruct``; log what has no pose, and add numbers to the notes.

    ``frame_keys`` are those that the frames were made with: advice is of what can be changed. UserError if there is no model, or
    it registers a smaller share of the frames than ``min_registered``.
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
    model, *others = sorted(models, key=lambda each: (-each.num_reg_images(), -each.num_points3D()))
    frames, registered = notes["frames"], _frames(model)
    left = [shown for other in others if (shown := _frames(other)) - registered]
    if parallax == 0 and len(registered) < min_registered * frames:
        raise UserError(nothing)
    for shown in left:
        log(
            f"COLMAP: a model of {len(shown)} frames ({format_ranges(shown)}) is left out: too little connects it to the largest"
        )
    denser = ", or lower frames.stride" if frame_keys.get("stride", 1) > 1 else ""
    if left:
        log(f"COLMAP: to connect the models, record the ways between them{denser}")
    if lost := format_ranges(set(range(frames)) - registered):
        log(
            f"COLMAP: {frames - len(registered)} of {frames} frames have no pose and are not used (indices from 0): {lost}; "
            "they are blurred, blank, or share too little with the others"
        )
    if len(registered) < min_registered * frames:
        (camera,) = model.cameras.values()
        side, matching = max(camera.width, camera.height), notes["matching"]
        wanted = (
            f"{len(registered)} of {frames} frames, and poses.min_registered requires {min_registered:.0%}"
        )
        raise UserError(
            f"COLMAP registers {wanted}; not registered (indices from 0): {lost}\n"
            f"{advice_on_few(matching, side, frame_keys)}, or accept the loss by poses.min_registered"
        )
    notes["models"] = [len(registered), *map(len, left)]
    notes["seam"] = find_seam(model)
    return model


def find_seam(model: pycolmap.Reconstruction) -> dict[str, float]:
    """Where a model nearly falls apart in time: the frame ``after`` which fewest points are seen both up to it and later, and their
    ``share`` of the points in the median frame. A tenth of the frames at either end does not count: few may see what they show."""
    images = registered_images(model)
    frame_of = {image.image_id: frame for frame, image in images}
    seen = ([frame_of[one.image_id] for one in point.track.elements] for point in model.points3D.values())
    first, last = np.sort([(min(each), max(each)) for each in seen], axis=0).T
    edge = len(images) // 10
    inner = np.sort([*frame_of.values()])[edge : len(images) - 1 - edge]
    across = np.searchsorted(first, inner, "right") - np.searchsorted(last, inner, "right")
    weakest = int(across.argmin())
    return {
        "after": int(inner[weakest]),
        "share": float(across[weakest] / np.median([image.num_points3D for _, image in images])),
    }


def _frames(model: pycolmap.Reconstruction) -> set[int]:
    return {frame for frame, _ in registered_images(model)}


def registered_images(model: pycolmap.Reconstruction) -> list[tuple[int, pycolmap.Image]]:
    """The frame and the image of all images with a pose, which are named by the numbers of their frames."""
    images = [model.images[number] for number in model.reg_image_ids()]
    return [(int(Path(image.name).stem), image) for image in images]


def adjust(model: pycolmap.Reconstruction) -> None:
    """Refine poses, points, focal length and distortion of a model in place; the principal point is kept."""
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    # With more threads, the result depends on their order.
    options.ceres.solver_options.num_threads = 1
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.reg_image_ids():
        config.add_image(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # ``pycolmap.bundle_adjustment`` does the same, and logs past every level.
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()


def advice_on_few(matching: str, side: int, frame_keys: Mapping[str, Any]) -> str:
    """What to do where too few frames, whose longer side is ``side`` [px], have a pose."""
    # Frames that are smaller than asked for have the size of the recording.
    larger = frame_keys.get("resolution", side) <= side < _FEW_PIXELS
    advice = [
        f"set frames.resolution={_FEW_PIXELS}, as {side} px show few details" if larger else "",
        "lower frames.stride" if frame_keys.get("stride", 1) > 1 else "add views in between",
        "take the part that shows one place (frames.start_s, frames.end_s)",
        "remove blurred and blank frames",
        "set poses.matching=exhaustive" if matching == "sequential" else "",
    ]
    advised = ", or ".join(filter(None, advice))
    return f"{advised[0].upper()}{advised[1:]}"
