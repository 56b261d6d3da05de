"""Boxes drawn by hand around things of real recordings, and what they say of instances and answers."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from egosplat.gaussians.render import view_of
from egosplat.query.answers import Answer, Thing
from egosplat.query.finished_scene import Scene
from egosplat.query.scene import rendering_camera
from egosplat.rasterize.view import composite

HERE = Path(__file__).parent

# Longer side of the views that compare things with boxes [px].
SIDE = 256

# Coverage from which a pixel shows a thing; pixels that show it at least; IoU of boxes from which an instance is a thing's.
_COVERED, _LEAST, SAME = 0.5, 12, 0.5

# left, top, right, bottom in percent of the frame.
Box = tuple[float, float, float, float]
Mask = NDArray[np.bool_]


def read_boxes(recording: str) -> pd.DataFrame:
    """The frame, the name and the ``box`` of each box of a recording."""
    table = pd.read_csv(HERE / "boxes.tsv", sep="\t").query("recording == @recording").reset_index(drop=True)
    return table.assign(box=[*map(tuple, table[["left", "top", "right", "bottom"]].to_numpy())])


def box_of(mask: Mask) -> Box | None:
    """The box around most of the pixels of an (H, W) mask, without a hundredth at each end; None if there are too few."""
    rows, columns = np.nonzero(mask)
    if len(rows) < _LEAST:
        return None
    (left, right), (top, bottom) = (np.quantile(each, (0.01, 0.99)) for each in (columns, rows))
    height, width = mask.shape
    return 100 * left / width, 100 * top / height, 100 * (right + 1) / width, 100 * (bottom + 1) / height


def overlap(one: Box, other: Box) -> float:
    """IoU of two boxes."""
    sides = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    common = float(np.prod(np.maximum(sides, 0)))
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return common / (sum(areas) - common)


def best_instance(scene: Scene, frame: int, box: Box) -> tuple[float, int]:
    """The best IoU of a box with the box of an instance in the labels of a frame, and this instance; 0 and -1 without any."""
    best = 0.0, -1
    for labels in scene.artifact("instances").row("labels", frame):
        for number in np.unique(labels[labels >= 0]).tolist():
            if found := box_of(labels == number):
                best = max(best, (overlap(found, box), number))
    return best


def are_there(
    scene: Scene, answers: Sequence[Answer], boxes: pd.DataFrame, names: Sequence[str]
) -> list[bool | None]:
    """Whether the best thing of each answer, found or not, or what moves, is one of its name, by ``is_one``."""
    frames = boxes["frame"].unique().tolist()
    best = [next(iter(answer.candidates), None) for answer in answers]
    shown = {frame: _shown(scene, best, frame) for frame in frames if np.isfinite(scene.poses[frame]).all()}
    labels, judged = scene.artifact("instances"), []
    for row, (answer, name) in enumerate(zip(answers, names, strict=True)):
        masks = {frame: each[row] for frame, each in shown.items()}
        if answer.moving:
            tracks = answer.moving.tracks
            masks = {frame: np.isin(labels.row("labels", frame), tracks).any(axis=0) for frame in frames}
        judged.append(is_one(masks, boxes, name))
    return judged


def is_one(masks: Mapping[int, Mask], boxes: pd.DataFrame, name: str) -> bool | None:
    """Whether a thing is one of a name: in the frame that shows most of it, its box fits one of that name best, in which its middle
    lies; by its pixels in frames with boxes. None if no such frame shows it."""
    frame = max(masks, key=lambda one: masks[one].mean(), default=None)
    if frame is None or (found := box_of(masks[frame])) is None:
        return None
    rows, (left, top, right, bottom) = boxes[boxes["frame"] == frame], found
    best = rows.iloc[int(np.argmax([overlap(found, box) for box in rows["box"]]))]
    x0, y0, x1, y1 = best["box"]
    inside = x0 <= (left + right) / 2 <= x1 and y0 <= (top + bottom) / 2 <= y1
    return bool(best["name"] == name and inside)


def _shown(scene: Scene, things: Sequence[Thing | None], frame: int) -> Mask:
    """(T, h, w) the pixels of a frame that each thing covers."""
    trained, camera = scene.trained, rendering_camera(scene.camera, SIDE)
    members = torch.zeros(trained.gaussians.count, len(things))
    for column, thing in enumerate(things):
        members[torch.from_numpy(thing.members) if thing else [], column] = 1.0
    with torch.inference_mode():
        view = view_of(trained.gaussians, camera, scene.poses[frame], trained.settings)
        covered, _ = composite(view, members.to(trained.code.device))
    return (covered > _COVERED).permute(2, 0, 1).cpu().numpy()
