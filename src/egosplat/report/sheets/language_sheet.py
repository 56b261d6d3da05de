"""Draw the codes of the Gaussians on one page: views through the recording, with the codes of each level as colors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.drawing import empty_grid, plt, show
from egosplat.geometry import Camera
from egosplat.language.rendering import render_codes
from egosplat.query.scene import TrainedScene, read_trained_scene, rendering_camera
from egosplat.report.sheets.sheet import sheet

# Maximum number of views.
VIEWS = 6

# Maximum side of a rendered image [px].
LONGEST_SIDE = 512

# Width of an image on the page [inches].
CELL = 2.9

# Gray level, 0..1, of pixels without a code.
UNKNOWN = 0.25

# Range of the colors, in standard deviations on either side of the mean.
SPREAD = 2.0


@dataclass(frozen=True)
class CodeColors:
    """An affine map of C-dimensional codes to colors: the first three principal components as red, green, blue.

    Attributes:
        mean: (C,) code shown as medium gray.
        axes: (3, C) principal axes, divided by the width of their range; 0 for a missing component.
    """

    mean: NDArray[np.float64]
    axes: NDArray[np.float64]

    def of(self, codes: NDArray[np.float32]) -> NDArray[np.float64]:
        """(..., 3) colors of (..., C) codes, not clipped: the color of a mean of codes is the mean of their colors."""
        return 0.5 + (codes - self.mean) @ self.axes.T


def blend(colors: NDArray[np.floating], coverage: NDArray[np.float32]) -> NDArray[np.float64]:
    """(..., 3) colors, clipped to [0, 1], blended with gray where the (...) coverage is below 1."""
    share = np.clip(coverage, 0.0, 1.0)[..., None]
    return share * np.clip(colors, 0.0, 1.0) + (1 - share) * UNKNOWN


@sheet(warned=("language",))
def run(poses: Artifact, splats: Artifact, language: Artifact) -> tuple[Figure, str]:
    """Draw views through the recording, with the codes of each level as colors."""
    scene = read_trained_scene(splats, "auto")
    levels = language.facts["levels"]
    camera = rendering_camera(scene.camera, LONGEST_SIDE)
    camera_to_world = camera_poses(poses, splats)
    frames = choose_frames(camera_to_world, poses.read("registered"), VIEWS)
    size = (CELL * VIEWS, (CELL * camera.height / camera.width + 0.25) * (1 + len(levels)) + 0.9)
    figure = plt.figure(figsize=size, layout="constrained")
    grid = empty_grid(figure, 1 + len(levels), VIEWS)
    _draw_views(grid, scene, {frame: camera_to_world[frame] for frame in frames}, language, camera)
    return figure, _summary(language)


def _summary(language: Artifact) -> str:
    return (
        f"language codes of the Gaussians ({language.facts['method']}), origin {language.origin}\n"
        "views of the recording, as different as possible: rendered colors, and codes of each level; similar colors are "
        "similar features; "
        "dark gray: no code, because no training view shows an instance"
    )


@torch.no_grad()
def _draw_views(
    grid: NDArray[Any],
    scene: TrainedScene,
    poses: Mapping[int, NDArray[np.float64]],
    language: Artifact,
    camera: Camera,
) -> None:
    """Draw a column for each frame of ``poses``, which has its (4, 4) camera_to_world."""
    code, share = language.read("code"), language.read("share")
    # Three numbers of a Gaussian are rendered in place of its code.
    colors = principal_colors(code, share).of(code).astype(np.float32)
    shown, shares = (torch.from_numpy(one).to(scene.gaussians.means.device) for one in (colors, share))
    for column, (frame, pose) in enumerate(poses.items()):
        show(grid[0, column], scene.picture(camera, pose), f"as in frame {frame}")
        rendered = render_codes(scene.gaussians, shown, shares, camera, pose, scene.settings)
        for row, name in enumerate(language.facts["levels"]):
            coverage = rendered.coverage[row].cpu().numpy()
            picture = blend(rendered.codes[row].cpu().numpy(), coverage)
            show(grid[1 + row, column], picture, f"{name}: {coverage.mean():.0%} covered by codes")


def principal_colors(code: NDArray[np.float32], share: NDArray[np.float32]) -> CodeColors:
    """Fit one color map to (N, L, C) codes of all levels, weighted by their (N, L) shares: equal codes have equal colors."""
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
    return CodeColors(mean, _scaled(variance[::-1][:3], vectors.T[::-1][:3]))


def _scaled(variance: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, C) axes of ``CodeColors`` from at most three principal components, the largest first."""
    axes = np.zeros((3, vectors.shape[1]))
    for axis, value, vector in zip(axes, variance, vectors, strict=False):
        if value > 1e-9 * max(variance[0], 1e-9):
            # The sign of an eigenvector is arbitrary. Making its largest entry positive keeps colors reproducible.
            sign = np.sign(vector[np.argmax(np.abs(vector))])
            axis[:] = sign * vector / (2 * SPREAD * np.sqrt(value))
    return axes


def choose_frames(
    camera_to_world: NDArray[np.float64], registered: NDArray[np.bool_], most: int
) -> list[int]:
    """Choose frames that see different parts of the scene: each is as far as possible from all chosen before.

    Cameras of the recording saw what they look at; a virtual camera may look where nothing is.

    Args:
        camera_to_world: (F, 4, 4), OpenCV axes.
        registered: (F,) which frames have a pose, at least one.

    Returns:
        At most ``most`` frames, in order of time, the first registered one among them.
    """
    rows = np.flatnonzero(registered)
    places, directions = camera_to_world[rows, :3, 3], camera_to_world[rows, :3, 2]
    # A step across all places counts as much as a half turn.
    extent = max(float(np.linalg.norm(np.ptp(places, axis=0))), np.finfo(float).tiny)
    described = np.concatenate([2.0 * places / extent, directions], axis=1)
    chosen, nearest = [0], np.full(len(rows), np.inf)
    while len(chosen) < min(most, len(rows)):
        nearest = np.minimum(nearest, np.linalg.norm(described - described[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(nearest)))
    return sorted(int(rows[one]) for one in set(chosen))
