"""The frames that a scene is evaluated in: their truth, their cameras and their renders."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from egosplat.artifacts.reader import Artifact
from egosplat.evaluation.queries import InstanceMap, Mask, instances_of, read_map
from egosplat.evaluation.rendering import RegionScore, region_scores, regions
from egosplat.frames.recording import Instance
from egosplat.geometry import Array, Camera


@dataclass(frozen=True)
class Frame:
    """An evaluation frame.

    Attributes:
        row: in annotations.zarr.
        index: in frames.zarr.
        annotated, registered: whether it has an annotation, and a pose.
        trained_on: whether it is a training frame as well.
        held_out: row of its render in splats.zarr; None where it was trained on, or has no pose.
    """

    row: int
    index: int
    annotated: bool
    registered: bool
    trained_on: bool
    held_out: int | None

    @property
    def asked(self) -> bool:
        """Whether queries are asked in it: it has truth, and a place to look from."""
        return self.annotated and self.registered


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What the benchmark looks at; the artifacts belong together.

    Attributes:
        pictures, annotations, splats: the artifacts; the pictures are frames.zarr.
        frames: the evaluation frames, in order.
        instances: that the instance maps' indices mean.
        valid: (H, W) bool pixels that show the scene.
        camera: of all frames.
        camera_to_world: (F, 4, 4) float64, NaN where there is no pose.
    """

    pictures: Artifact
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

    def rendering_of(self, frame: Frame) -> Mapping[str, RegionScore]:
        """How well a held-out frame is rendered: where it is annotated by group of pixels, else all of them alone.

        Of a frame that was trained on, or has no pose, there is no score.
        """
        if frame.held_out is None:
            return {}
        groups: Mapping[str, Mask] = {"all": self.valid}
        if frame.annotated:
            groups = regions(self.map_of(frame), self.instances, self.valid)
        render = self.splats.row("held_out/render", frame.held_out)
        return region_scores(render, self.pictures.row("rgb", frame.index), self.valid, groups)


def read_evaluation(
    pictures: Artifact, poses: Artifact, annotations: Artifact, splats: Artifact
) -> Evaluation:
    """Read it."""
    _, height, width, _ = pictures.shape("rgb")
    return Evaluation(
        pictures=pictures,
        annotations=annotations,
        splats=splats,
        frames=_frames(pictures, poses, annotations, splats),
        instances=instances_of(annotations),
        valid=pictures.read("valid"),
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        camera_to_world=poses.read("camera_to_world"),
    )


def _frames(pictures: Artifact, poses: Artifact, annotations: Artifact, splats: Artifact) -> list[Frame]:
    rendered = {int(frame): row for row, frame in enumerate(splats.read("held_out/frame"))}
    train, registered = pictures.read("train"), poses.read("registered")
    index, annotated = annotations.read("frame"), annotations.read("annotated")
    flags = np.stack([annotated, registered[index], train[index]], axis=1).tolist()
    return [
        Frame(row, int(frame), *own, rendered.get(int(frame)))
        for row, (frame, own) in enumerate(zip(index, flags, strict=True))
    ]
