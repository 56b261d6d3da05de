"""The evaluation frames of a scene: their annotations and cameras, and PSNR and SSIM of their renders, as in EgoLifter."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from egosplat.arrays import Array, Bools, Bytes, Ints32
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
from egosplat.evaluation.queries import GROUPS, Query, find_queries, instances_of
from egosplat.frames.recording import Instance
from egosplat.geometry import Camera
from egosplat.image_quality import mean_ssim, psnr, ssim_map

# Schemas of a scene that is scored, without what OpenCLIP encoded.
SCORED = (FRAMES, POSES, ANNOTATIONS, SPLATS, LANGUAGE)


@dataclass(frozen=True)
class RegionScore:
    """PSNR [dB], infinite for equal images, and mean SSIM of one region of an image; NaN without a pixel with a value."""

    pixels: int
    psnr: float
    ssim: float


@dataclass(frozen=True)
class Frame:
    """An evaluation frame, which may also be trained on: its row in annotations.zarr, its index in frames.zarr, and the
    ``held_out`` row of its render in splats.zarr, None for a training frame or a frame without a pose."""

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
    """The evaluation frames with their artifacts, the instances by their index in the instance maps, the (H, W) bool ``valid``
    pixels that show the scene, (F, 4, 4) float64 poses, NaN without one, and the array of splats.zarr that holds renders."""

    frames_artifact: Artifact
    annotations: Artifact
    splats: Artifact
    frames: list[Frame]
    instances: list[Instance]
    valid: Bools
    camera: Camera
    camera_to_world: Array
    renders: str

    def map_of(self, frame: Frame) -> Ints32:
        """(H, W) int32 instance map of an annotated frame, -1 for none."""
        return np.where(self.valid, self.annotations.row("instance_map", frame.row), np.int32(-1))

    def find_queries(self, options: ScoringOptions) -> list[Query]:
        """The queries of the frames with a pose: without one there is no view to render, which is no fault of the answer."""
        every = find_queries(self.annotations, self.valid, options)
        return [query for query in every if self.frames[query.row].asked]

    def rendering_of(self, frame: Frame, picture: Bytes | None = None) -> Mapping[str, RegionScore]:
        """Scores of a held-out frame's render, or of another picture: by group if it is annotated, else of all pixels only; empty for
        a training frame and for a frame without a pose."""
        if frame.held_out is None:
            return {}
        shown = shown_pixels(self.frames_artifact, frame.index, self.valid)
        groups: Mapping[str, Bools] = {"all": shown}
        if frame.annotated:
            groups = regions(self.map_of(frame), self.instances, shown)
        picture = self.splats.row(self.renders, frame.held_out) if picture is None else picture
        return region_scores(picture, self.frames_artifact.row("rgb", frame.index), shown, groups)


def read_evaluation(
    frames: Artifact, poses: Artifact, annotations: Artifact, splats: Artifact, held_out: str = "corrected"
) -> Evaluation:
    """Read the evaluation frames from artifacts that belong together, with poses as ``metrics.held_out`` says."""
    _, height, width, _ = frames.shape("rgb")
    rendered = {frame: row for row, frame in enumerate(splats.read("held_out/frame").tolist())}
    index = annotations.read("frame")
    flags = annotations.read("annotated"), poses.read("registered")[index], frames.read("train")[index]
    given = held_out == "given" and splats.has("held_out/render_given")
    rows = enumerate(zip(index.tolist(), np.stack(flags, axis=1).tolist(), strict=True))
    return Evaluation(
        frames_artifact=frames,
        annotations=annotations,
        splats=splats,
        frames=[Frame(row, frame, *given, held_out=rendered.get(frame)) for row, (frame, given) in rows],
        instances=instances_of(annotations),
        valid=frames.read("valid"),
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        camera_to_world=poses.read("camera_to_world") if given else camera_poses(poses, splats),
        renders="held_out/render_given" if given else "held_out/render",
    )


def summarise_rendering(scores: Sequence[Mapping[str, RegionScore]]) -> dict[str, dict[str, float]]:
    """Number of images with a pixel, mean PSNR and mean SSIM of each of ``GROUPS``, as in ``metrics.json``; NaN without any."""
    summary = {}
    for name in GROUPS:
        seen = [groups[name] for groups in scores if name in groups and groups[name].pixels]
        ssims = [score.ssim for score in seen if not math.isnan(score.ssim)]
        summary[name] = {"frames": len(seen), "psnr": _mean([one.psnr for one in seen]), "ssim": _mean(ssims)}
    return summary


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan


def regions(instance_map: Ints32, instances: Sequence[Instance], valid: Bools) -> dict[str, Bools]:
    """The (H, W) bool valid pixels of each group; those without annotation, -1 in the int32 map, are static."""
    # Index -1 selects the last entry.
    is_dynamic = np.array([*(instance.motion_type == "dynamic" for instance in instances), False])
    dynamic = is_dynamic[instance_map] & valid
    return {"static": valid & ~dynamic, "dynamic": dynamic, "all": valid}


def region_scores(
    render: Bytes, photograph: Bytes, valid: Bools, groups: Mapping[str, Bools]
) -> dict[str, RegionScore]:
    """PSNR and SSIM of groups of valid pixels in (H, W, 3) uint8 images, see ``egosplat.image_quality``."""
    image, target = torch.from_numpy(render), torch.from_numpy(photograph)
    # SSIM compares windows of 11 x 11 pixels, so it also depends on pixels just outside a region.
    ssim = ssim_map(image, target, torch.from_numpy(valid))
    masks = {name: torch.from_numpy(mask) for name, mask in groups.items()}
    return {
        name: RegionScore(int(mask.sum()), psnr(image, target, mask), mean_ssim(ssim, mask))
        for name, mask in masks.items()
    }
