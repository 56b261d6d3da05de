"""What the Gaussians mean, on one page: a look around from one place, and at each level their codes as colours."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.codes.rendering import render_codes
from egosplat.geometry import Camera, make_pose
from egosplat.output_files import check_output, picture_kind
from egosplat.query.scene import TrainedScene, read_trained_scene
from egosplat.report.figure import draw_heading, plt, save_figure

PAGE = picture_kind("egosplat language-sheet")

TURNS = 6
"""Views of a whole turn."""

NEAREST = 0.1
"""Of the frames so many, those nearest to the middle of the walk, are candidates to look around from."""

LONGEST_SIDE = 512
"""Pixels that a rendered picture has at most along a side."""

CELL = 2.9
"""Width of a picture on the page, in inches."""

UNKNOWN = 0.25
"""Grey, 0..1, of what shows no instance with a code."""

SPREAD = 2.0
"""Standard deviations on either side of the mean that the colours reach."""


@dataclass(frozen=True)
class CodeColours:
    """An affine map of C-dimensional codes to colours: the first three principal components as red, green, blue.

    Attributes:
        mean: (C,) code that is shown in the middle of all three.
        axes: (3, C), each a unit vector divided by the width of the range; 0 where there is no such component.
    """

    mean: NDArray[np.float64]
    axes: NDArray[np.float64]

    def paint(self, codes: NDArray[np.float32], coverage: NDArray[np.float32]) -> NDArray[np.float64]:
        """(..., 3) colours in [0, 1] of (..., C) codes, on grey where the (...) coverage is below 1."""
        colours = np.clip(0.5 + (codes - self.mean) @ self.axes.T, 0.0, 1.0)
        share = np.clip(coverage, 0.0, 1.0)[..., None]
        return share * colours + (1 - share) * UNKNOWN


def run(poses: Path, splats: Path, language: Path, output: Path, *, title: str) -> None:
    """Draw the page as PNG; the file appears when it is complete.

    Raises:
        UserError: the inputs do not belong together.
    """
    check_output(output, PAGE)
    walk, trained = open_artifact(poses, POSES), open_artifact(splats, SPLATS)
    meaning = open_artifact(language, LANGUAGE)
    check_made_from(trained, walk)
    check_made_from(meaning, walk, trained)
    scene = read_trained_scene(trained, "auto")
    levels = meaning.facts["levels"]
    camera = _reduced(scene.camera)
    size = (CELL * TURNS, (CELL * camera.height / camera.width + 0.25) * (1 + len(levels)) + 0.9)
    figure, grid = plt.subplots(1 + len(levels), TURNS, squeeze=False, figsize=size, layout="constrained")
    draw_heading(figure, f"{title}: {_summary(meaning)}", warnings_of(meaning))
    _draw_views(grid, scene, walk, meaning, camera)
    save_figure(figure, output, PAGE)


def _reduced(camera: Camera) -> Camera:
    """The camera with its longer side at most ``LONGEST_SIDE``."""
    factor = min(LONGEST_SIDE / max(camera.width, camera.height), 1.0)
    return camera.scaled_to(max(round(factor * camera.width), 1), max(round(factor * camera.height), 1))


def _summary(meaning: Artifact) -> str:
    return (
        f"what the Gaussians mean ({meaning.facts['method']}), origin {meaning.origin}\n"
        f"a look around from one place, as colours and at each level as codes: the more alike two colours, the more "
        "alike the meaning; dark grey where the training views show no instance"
    )


@torch.no_grad()
def _draw_views(
    grid: NDArray[np.object_], scene: TrainedScene, walk: Artifact, meaning: Artifact, camera: Camera
) -> None:
    code, share = meaning.read("code"), meaning.read("share")
    colours, device = principal_colours(code, share), scene.gaussians.means.device
    poses, up = walk.read("camera_to_world"), walk.read("up")
    frame = choose_place(poses, walk.read("registered"), up)
    for column, turn in enumerate(np.arange(TURNS) * 360.0 / TURNS):
        pose = turned_right(poses[frame], up, turn)
        heading = f"turned {turn:.0f}° to the right" if column else f"as in frame {frame}"
        _show(grid[0, column], scene.picture(camera, pose), heading)
        rendered = render_codes(
            scene.gaussians,
            torch.from_numpy(code).to(device),
            torch.from_numpy(share).to(device),
            camera,
            pose,
            scene.settings,
        )
        for row, name in enumerate(meaning.facts["levels"]):
            coverage = rendered.coverage[row].cpu().numpy()
            picture = colours.paint(rendered.codes[row].cpu().numpy(), coverage)
            _show(grid[1 + row, column], picture, f"{name}: {coverage.mean():.0%} has a meaning")


def principal_colours(code: NDArray[np.float32], share: NDArray[np.float32]) -> CodeColours:
    """The colours of codes, of all levels together: the same code has the same colour everywhere.

    Args:
        code: (N, L, C), each weighing by its share.
        share: (N, L) in [0, 1].
    """
    channels = code.shape[2]
    total, first, second = 0.0, np.zeros(channels), np.zeros((channels, channels))
    for level in range(code.shape[1]):
        seen = share[:, level] > 0
        values, weight = code[seen, level].astype(np.float64), share[seen, level].astype(np.float64)
        total += weight.sum()
        first += weight @ values
        second += (values * weight[:, None]).T @ values
    mean = first / max(total, np.finfo(float).tiny)
    variance, vectors = np.linalg.eigh(second / max(total, np.finfo(float).tiny) - np.outer(mean, mean))
    return CodeColours(mean, _scaled(variance[::-1][:3], vectors.T[::-1][:3]))


def _scaled(variance: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, C) axes of ``CodeColours`` from at most three components, the largest first."""
    axes = np.zeros((3, vectors.shape[1]))
    for axis, value, vector in zip(axes, variance, vectors, strict=False):
        if value > 1e-9 * max(variance[0], 1e-9):
            # An eigenvector's sign is arbitrary: its largest entry is made positive.
            sign = np.sign(vector[np.argmax(np.abs(vector))])
            axis[:] = sign * vector / (2 * SPREAD * np.sqrt(value))
    return axes


def choose_place(poses: NDArray[np.float64], registered: NDArray[np.bool_], up: NDArray[np.float64]) -> int:
    """The frame to look around from: near the middle of the walk, where the wearer has been and may look around
    without a wall before the eyes, and of these the one that looks most nearly level.

    Args:
        poses: (F, 4, 4) camera_to_world; registered: (F,), one at least; up: (3,) unit vector against gravity.
    """
    rows = np.flatnonzero(registered)
    places = poses[rows, :3, 3]
    distance = np.linalg.norm(places - np.median(places, axis=0), axis=1)
    nearest = rows[np.argsort(distance, kind="stable")[: max(1, round(NEAREST * len(rows)))]]
    return int(nearest[np.argmin(np.abs(poses[nearest, :3, 2] @ up))])


def turned_right(pose: NDArray[np.float64], up: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """A (4, 4) camera_to_world turned in place about ``up``, clockwise as seen from above."""
    rotation = Rotation.from_rotvec(-np.radians(degrees) * up).as_matrix()
    return make_pose(rotation @ pose[:3, :3], pose[:3, 3])


def _show(cell: Axes, picture: NDArray, title: str) -> None:
    cell.imshow(picture)
    cell.set_title(title, fontsize=9)
    cell.set_axis_off()
