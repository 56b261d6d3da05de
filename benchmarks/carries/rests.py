"""Rests against the truth of rooms where people carry things."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.carries.truth import Rest, read_rests, recording_of, scene_of
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS
from egosplat.evaluation.evaluation_frames import Evaluation, Frame, read_evaluation
from egosplat.geometry import Array
from egosplat.histories.known import Rests
from egosplat.query.finished_scene import Scene

# A rest is right if it overlaps a true one by this IoU in time, at this distance of its box at most [m].
IOU, NEAR_M = 0.5, 0.1

# Frames that show fewer pixels of carried things at rest are left out.
LEAST_PIXELS = 20

COLUMNS = (
    "scene",
    "true rests",
    "found",
    "rests told",
    "right",
    "of a true one",
    "frames",
    "PSNR of what rests",
    "at its time",
    "static",
    "static at its time",
    "CPU-s",
)


@dataclass(frozen=True)
class Figures:
    """Counts of rests, and squared errors of pixels, (V, 2) without and with rests, of each frame."""

    true: int
    found: int
    told: int
    right: int
    partly: int
    resting: Array
    static: Array

    def cells(self) -> list[object]:
        """Cells of a row: PSNR is a mean over frames [dB]."""
        decibels = [*_decibels(self.resting), *_decibels(self.static)]
        counts = self.true, self.found, self.told, self.right, self.partly, len(self.resting)
        return [*counts, *(f"{one:.2f}" for one in decibels)]

    @staticmethod
    def total(parts: Sequence["Figures"]) -> "Figures":
        """All scenes together."""
        names = list(Figures.__dataclass_fields__)
        counts = {name: sum(getattr(one, name) for one in parts) for name in names[:-2]}
        return Figures(
            **counts, **{name: np.concatenate([getattr(one, name) for one in parts]) for name in names[-2:]}
        )


def _decibels(errors: Array) -> Array:
    """(2,) mean PSNR of frames with mean squared errors (V, 2)."""
    return (-10 * np.log10(np.maximum(errors, 1e-10))).mean(axis=0) if len(errors) else np.full(2, np.nan)


def measure(scene: Scene, rests: Rests) -> Figures:
    """Compare rests of a scene, and the renders of its held-out frames, with its truth."""
    frames, splats = scene.artifact("frames"), scene.artifact("splats")
    annotations = open_artifact(scene_of(scene.folder) / "annotations.zarr", ANNOTATIONS)
    evaluation = read_evaluation(frames, scene.artifact("poses"), annotations, splats)
    true = read_rests(recording_of(scene.folder), frames.read("timestamp_ns"))
    ious, near = _overlaps(rests, true)
    right = (ious >= IOU) & (near <= NEAR_M)
    errors = [*_errors(scene, evaluation, rests, true)]
    return Figures(
        true=len(true),
        found=int(right.any(axis=0).sum()),
        told=len(right),
        right=int(right.any(axis=1).sum()),
        partly=int(((ious > 0) & (near <= NEAR_M)).any(axis=1).sum()),
        resting=np.array([resting for resting, _ in errors if resting is not None]).reshape(-1, 2),
        static=np.array([static for _, static in errors]).reshape(-1, 2),
    )


def _overlaps(rests: Rests, true: Sequence[Rest]) -> tuple[Array, Array]:
    """(R, T) IoU in time and distance [m] of rests and true ones."""
    spans = zip(rests.from_s, rests.until_s, strict=True)
    ious = [[one.iou(first, last) for one in true] for first, last in spans]
    near = [one.distances(rests.center) for one in true]
    return np.array(ious).reshape(-1, len(true)), np.array(near).T.reshape(-1, len(true))


def _errors(scene: Scene, evaluation: Evaluation, rests: Rests, true: Sequence[Rest]):
    """Mean squared errors without and with rests of each held-out frame: of what rests then (None if too small), and of what is static."""
    names = [one.name for one in evaluation.instances]
    dynamic = [number for number, one in enumerate(evaluation.instances) if one.motion_type == "dynamic"]
    for frame in evaluation.frames:
        if frame.held_out is None or not frame.annotated:
            continue
        second = float(scene.seconds[frame.index])
        labels = evaluation.map_of(frame)
        here = [names.index(one.name) for one in true if one.from_s <= second <= one.until_s]
        resting = np.isin(labels, here)
        static = evaluation.valid & ~np.isin(labels, dynamic)
        pictures = [_error(scene, evaluation, frame, rests, time) for time in (None, second)]
        enough = resting.sum() >= LEAST_PIXELS
        yield (
            [one[resting].mean() for one in pictures] if enough else None,
            [one[static].mean() for one in pictures],
        )


def _error(
    scene: Scene, evaluation: Evaluation, frame: Frame, rests: Rests, second: float | None
) -> NDArray[np.float64]:
    """(H, W) squared error of a render, mean over colors."""
    shown = scene.trained.at(rests, second).picture(
        evaluation.camera, evaluation.camera_to_world[frame.index]
    )
    photograph = evaluation.frames_artifact.row("rgb", frame.index) / 255.0
    return ((shown - photograph) ** 2).mean(axis=-1)
