"""Measure the statistics of the alarms, from facts and arrays of artifacts: one function for each key of the table.

Each returns ``value``, which the limit is for, and what else the sentence tells; None where the value is not known. A value may be
(F,) one for each frame, of which the largest counts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from egosplat.artifacts.reader import Artifact

Figures = dict[str, Any]


def _share(part: float, whole: int, **more: float) -> Figures | None:
    return {"value": part / whole, **more} if whole else None


def fact(*names: str) -> Callable[[Artifact], Figures | None]:
    """Read a number among the facts of an artifact, or in a dictionary among them."""

    def read(artifact: Artifact) -> Figures | None:
        value: Any = artifact.facts
        for name in names:
            value = (value or {}).get(name)
        return None if value is None else {"value": value}

    return read


def mean(array: str) -> Callable[[Artifact], Figures | None]:
    """Average an array of an artifact but for NaN; None if there is nothing else."""

    def read(artifact: Artifact) -> Figures | None:
        values = artifact.read(array)
        return {"value": np.nanmean(values)} if not np.isnan(values).all() else None

    return read


def points_per_frame(poses: Artifact) -> Figures | None:
    notes = poses.facts.get("notes", {})
    # A device's own points are no structure from motion.
    own, points = "parallax_deg" not in notes, notes.get("points")
    return None if own and points != 0 else _share(points, int(poses.read("registered").sum()), points=points)


def unconnected_models(poses: Artifact) -> Figures | None:
    models = poses.facts.get("notes", {}).get("models", [])
    return {"value": len(models), "frames": ", ".join(map(str, models))}


def seam(poses: Artifact) -> Figures | None:
    found = poses.facts.get("notes", {}).get("seam")
    return found and {"value": found["share"], "after": found["after"]}


def masks_kept(instances: Artifact) -> Figures | None:
    if instances.facts.get("merging") is None:  # tracks
        return None
    kept = int(instances.read("instances/masks")[~instances.read("instances/moving")].sum())
    masks = sum(level["masks"] for level in instances.facts["merging"].values())
    return _share(kept, masks, kept=kept, masks=masks)


def lost_views(features: Artifact) -> Figures | None:
    lost = features.facts.get("without_feature", 0)
    views = lost + features.shape("instance")[0]
    return _share(lost, views, lost=lost, views=views)


def outlying_views(features: Artifact) -> Figures | None:
    outliers, views = features.facts.get("outliers", 0), features.shape("instance")[0]
    return _share(outliers, views, outliers=outliers, views=views)


def agreement(features: Artifact) -> Figures | None:
    cosine, spread = features.facts.get("agreement"), features.facts.get("spread", {}).get("features")
    if cosine is None or spread is None:
        return None
    return {"value": relative_agreement(cosine, spread), "cosine": cosine, "spread": spread}


def relative_agreement(cosine: float, spread: float) -> float:
    """Mean cosine of views with their instance's feature, from 0, as instances with each other (``spread``), to 1."""
    return (cosine - spread) / (1.0 - spread) if spread < 1.0 else 1.0


def withheld(masks: Artifact) -> Figures | None:
    names = {"probability": "mean_probability", "transient": "withheld_instances", "instances": "seen"}
    return {key: masks.facts[name] for key, name in names.items()} if masks.facts.get("withheld") else None


def transient_instances(masks: Artifact) -> Figures | None:
    moving = masks.read("instances/transient")
    return _share(int(moving.sum()), len(moving), transient=int(moving.sum()), instances=len(moving))


def largest_pose_correction(splats: Artifact) -> Figures | None:
    if not splats.has("corrections/shift") or not splats.shape("corrections/shift")[0]:
        return None
    shift, turn = np.linalg.norm(splats.read("corrections/shift"), axis=1), splats.read("corrections/turn")
    shift = shift / splats.facts["scene_depth"]
    # Frames without a pose have no correction.
    angle = np.nan_to_num(np.maximum(shift, np.radians(turn)), posinf=np.inf)
    most = int(angle.argmax())
    return {"value": angle, "frame": most, "shift": float(shift[most]), "turn_deg": float(turn[most])}


def largest_gain(splats: Artifact) -> Figures | None:
    if not splats.has("corrections/gain") or not splats.shape("corrections/gain")[0]:
        return None
    gain = splats.read("corrections/gain")
    factor = np.exp(np.abs(np.log(np.maximum(np.nan_to_num(gain, nan=1.0), 1e-9)))).max(axis=1)
    most = int(factor.argmax())
    colors = dict(zip(("red", "green", "blue"), map(float, gain[most]), strict=True))
    return {"value": factor, "frame": most, **colors}


def gaussians_without_code(language: Artifact) -> Figures | None:
    share = language.read("share")
    return {"value": (share <= 0).all(axis=1).mean()} if len(share) else None


MEASURES = {
    "frames.valid_pixels": mean("valid"),
    "poses.registered": mean("registered"),
    "poses.reprojection": fact("notes", "reprojection_error_px"),
    "poses.parallax": fact("notes", "parallax_deg"),
    "poses.points": points_per_frame,
    "poses.models": unconnected_models,
    "poses.seam": seam,
    "segments.empty_pixels": fact("pixels_without_instance"),
    "segments.instances_per_frame": fact("instances_per_frame"),
    "segments.frames_per_instance": fact("frames_per_instance"),
    "instances.masks_kept": masks_kept,
    "instances.empty_pixels": fact("pixels_without_instance"),
    "view_features.lost": lost_views,
    "features.outliers": outlying_views,
    "features.agreement": agreement,
    "features.reconstruction": fact("reconstruction", "mean"),
    "transient.probability": fact("mean_probability"),
    "masks.withheld": withheld,
    "masks.instances": transient_instances,
    "masks.pixels": fact("masked_share"),
    "splats.psnr": mean("held_out/psnr"),
    "splats.pose_correction": largest_pose_correction,
    "splats.gain": largest_gain,
    "language.without_code": gaussians_without_code,
}
