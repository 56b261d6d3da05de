"""The evaluation frames of a scene: their annotations, cameras and renders."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import (
    ANNOTATIONS,
    FRAMES,
    LANGUAGE,
    POSES,
    SPLATS,
    camera_poses,
    shown_pixels,
)
from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import InstanceMap, Mask, Query, find_queries, instances_of, read_map
from egosplat.evaluation.rendering import Picture, RegionScore, region_scores, regions
from egosplat.frames.recording import Instance
from egosplat.geometry import Array, Camera

# Schemas of a scene that is scored, without what OpenCLIP encoded.
SCORED = (FRAMES, POSES, ANNOTATIONS, SPLATS, LANGUAGE)


@dataclass(frozen=True)
class Frame:
    """An evaluation frame.

    Attributes:
        row, index: in annotations.zarr, and in frames.zarr.
        trained_on: whether it is also a training frame.
        held_out: row of its render in splats.zarr; None for a training frame or a frame without a pose.
    """

    row: int
    index: int
    annotated: bool
    registered: bool
    trained_on: bool
    held_out: int | None

    @property
    def asked(self) -> bool:
        """Whether it is queried: it has an annotation and a pose."""
        return self.annotated and self.registered


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The evaluation frames with their artifacts.

    Attributes:
        instances: by their index in the instance maps.
        valid: (H, W) bool pixels that show the scene.
        camera_to_world: (F, 4, 4) float64, NaN without a pose.
    """

    frames_artifact: Artifact
    annotations: Artifact
    splats: Artifact
    frames: list[Frame]
    instances: list[Instance]
    valid: Mask
    camera: Camera
    camera_to_world: Array

    def map_of(self, frame: Frame) -> InstanceMap:
        """(H, W) int32 instance map of an annotated frame, -1 for none."""
        return read_map(self.annotations, frame.row, self.valid)

    def rendering_of(
        self, frame: Frame, render: str | Picture = "held_out/render"
    ) -> Mapping[str, RegionScore]:
        """Scores of a held-out frame's render: by group if it is annotated, else of all pixels only.

        Empty for a training frame and for a frame without a pose. ``render`` is the picture, or names the array of splats.zarr.
        """
        if frame.held_out is None:
            return {}
        shown = shown_pixels(self.frames_artifact, frame.index, self.valid)
        groups: Mapping[str, Mask] = {"all": shown}
        if frame.annotated:
            groups = regions(self.map_of(frame), self.instances, shown)
        picture = self.splats.row(render, frame.held_out) if isinstance(render, str) else render
        return region_scores(picture, self.frames_artifact.row("rgb", frame.index), shown, groups)


def read_evaluation(frames: Artifact, poses: Artifact, annotations: Artifact, splats: Artifact) -> Evaluation:
    """Read the evaluation frames from artifacts that belong together."""
    _, height, width, _ = frames.shape("rgb")
    rendered = {int(frame): row for row, frame in enumerate(splats.read("held_out/frame"))}
    index, annotated = annotations.read("frame"), annotations.read("annotated")
    registered, train = poses.read("registered")[index], frames.read("train")[index]
    flags = np.stack([annotated, registered, train], axis=1).tolist()
    return Evaluation(
        frames_artifact=frames,
        annotations=annotations,
        splats=splats,
        frames=[
            Frame(row, frame, *of_frame, held_out=rendered.get(frame))
            for row, (frame, of_frame) in enumerate(zip(index.tolist(), flags, strict=True))
        ],
        instances=instances_of(annotations),
        valid=frames.read("valid"),
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        camera_to_world=camera_poses(poses, splats),
    )


def find_asked_queries(
    annotations: Artifact, valid: Mask, options: ScoringOptions, frames: Sequence[Frame]
) -> list[Query]:
    """The queries of the frames with a pose, see ``find_queries``."""
    # Without a pose there is no view to render, which is no fault of the answer.
    asked = {frame.row for frame in frames if frame.asked}
    return [query for query in find_queries(annotations, valid, options) if query.row in asked]


def count_frames(
    frames: Artifact, evaluated: Sequence[Frame], instances: Sequence[Instance]
) -> dict[str, int]:
    """Numbers of frames and annotated instances, for ``counts`` of ``metrics.json``."""
    return {
        "frames": frames.shape("rgb")[0],
        "evaluation_frames": len(evaluated),
        "evaluation_frames_annotated": sum(frame.annotated for frame in evaluated),
        "evaluation_frames_asked": sum(frame.asked for frame in evaluated),
        "evaluation_frames_trained_on": sum(frame.trained_on for frame in evaluated),
        "evaluation_frames_without_pose": sum(not frame.registered for frame in evaluated),
        "annotated_instances": len(instances),
    }
