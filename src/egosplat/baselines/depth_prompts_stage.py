"""Stage ``prompts``: the points that SAM2 is prompted with where ``segments.point_prompts`` is depth, as in GAGS."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.prompts import PROMPTS
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.artifacts.writer import create
from egosplat.baselines.options import PromptsOptions
from egosplat.codes.centers import project_centers
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.training_views import split_views
from egosplat.geometry import Array, Camera
from egosplat.progress import log, track

# Published: a view sees a Gaussian whose depth is that of the surface at its pixel, up to this share.
TOLERANCE = 0.25


def run(
    frames_path: Path,
    poses_path: Path,
    splats_path: Path,
    output: Path,
    options: PromptsOptions,
    *,
    survey_path: Path | None = None,
) -> None:
    """Write the points of the training frames that have a pose.

    Args:
        survey_path: excludes frames.

    Raises:
        UserError: the inputs do not belong together, no training frame has a pose, or the backend cannot run.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    splats = open_artifact(splats_path, SPLATS)
    check_made_from(poses, frames, axes=("frame",))
    check_made_from(splats, frames, poses)
    kept, by_survey = kept_frames(frames, survey_path)
    record = provenance.begin_from("prompts", options.as_dict() | by_survey, [frames, poses, splats])
    flags = frames.read("train") & kept, frames.read("evaluation"), poses.read("registered")
    rows = np.flatnonzero(split_views(*flags).training)
    _, height, width, _ = frames.shape("rgb")
    views = SplatViews(
        gaussians=read_gaussians(splats).to(training_device(options.backend)),
        settings=read_render_settings(splats, options.backend),
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        camera_to_world=camera_poses(poses, splats)[rows],
        valid=frames.read("valid"),
    )
    points = [
        draw_points(sides, centers, np.random.default_rng([options.seed, row]))
        for row, (sides, centers) in zip(rows.tolist(), densities(views), strict=True)
    ]
    counts = [len(one) for one in points]
    with create(output, PROMPTS, record) as artifact:
        artifact.put("frame", np.repeat(rows, counts).astype(np.int32))
        artifact.put("position", np.concatenate(points))
        artifact.facts = {"views": len(rows), "points_a_view": float(np.mean(counts))}
    log(f"{np.mean(counts):.0f} points a frame, {min(counts)} to {max(counts)}")


@dataclass(frozen=True, eq=False)
class SplatViews:
    """V views of N Gaussians: (V, 4, 4) float64 poses with OpenCV axes in meters, (H, W) bool pixels that show the scene."""

    gaussians: Gaussians
    settings: RenderSettings
    camera: Camera
    camera_to_world: Array
    valid: NDArray[np.bool_]

    @torch.no_grad()
    def look(self, view: int) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
        """Find the surfaces of a view, and the M Gaussians that it sees.

        Returns:
            (H, W) expected camera z [m], 0 without a surface; (M,) index of each Gaussian; (M, 2) column and row of its pixel.
        """
        about = self.camera, self.camera_to_world[view], self.settings
        image, _, _ = render(self.gaussians, *about, sh_degree=0, background=None, render_mode="ED")
        depth = np.where(self.valid, image[..., 0].double().cpu().numpy(), 0.0)
        gaussian, pixel, own = project_centers(self.gaussians, *about)
        surface = depth[pixel[:, 1], pixel[:, 0]]
        # Without a surface, no Gaussian: one in view is farther than the near plane.
        seen = abs(surface - own[gaussian]) <= TOLERANCE * surface
        return depth, gaussian[seen], pixel[seen]


def densities(views: SplatViews) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """The sides of the cells, and the pixels that hold a center, of each view; see ``draw_points``."""
    # The views are rendered twice: depths of all of them take memory by the length of the recording.
    every = range(len(views.camera_to_world))
    nearest = np.full(views.gaussians.count, np.inf)
    for view in track(every, "finding nearest views", unit="view"):
        depth, gaussian, pixel = views.look(view)
        nearest[gaussian] = np.minimum(nearest[gaussian], depth[pixel[:, 1], pixel[:, 0]])
    for view in track(every, "placing prompts", unit="view"):
        depth, gaussian, pixel = views.look(view)
        least = np.zeros_like(depth)
        least[pixel[:, 1], pixel[:, 0]] = nearest[gaussian]
        yield points_a_side(cell_ratios(depth, least)), least > 0


# Published: cells a side of an image, and parts a side of a cell.
CELLS, PARTS = 8, 10

# Published: points a side of a cell for a ratio of 1, and their maximum.
_DENSITY, _MOST = 4, 20

# Ratios this much below a limit reach it: at a wall seen from straight ahead, rounding would decide.
_ROUNDING = 1e-4


def cell_ratios(depth: NDArray[np.float64], least: NDArray[np.float64]) -> NDArray[np.float64]:
    """How many times as far as in the nearest view each cell of a view is.

    Args:
        depth: (H, W) camera z of the surfaces [m]; 0 without one.
        least: (H, W) least depth of the Gaussian whose center a pixel holds, over all views that see it [m]; 0 without one.

    Returns:
        (CELLS, CELLS) mean depth over mean least depth, each over the pixels that have one; NaN where none has.
    """
    cell = _squares(depth.shape, CELLS)
    with np.errstate(invalid="ignore"):  # 0 / 0: a cell without a surface, or without a center
        means = [
            np.bincount(cell.ravel(), values.ravel(), CELLS**2)
            / np.bincount(cell.ravel(), (values > 0).ravel(), CELLS**2)
            for values in (depth, least)
        ]
        return (means[0] / means[1]).reshape(CELLS, CELLS)


def points_a_side(ratios: NDArray[np.float64]) -> NDArray[np.int64]:
    """Side of the square number of points in a cell: 4 times its ratio, 1 to 20; 1 for a ratio below 1 or NaN."""
    reached = np.nan_to_num(ratios) + _ROUNDING
    return np.where(reached < 1, 1, np.clip(_DENSITY * reached, 1, _MOST)).astype(np.int64)


def draw_points(
    sides: NDArray[np.int64], centers: NDArray[np.bool_], random: np.random.Generator
) -> NDArray[np.float32]:
    """Draw points in each cell of a view, more in the parts of a cell that hold more centers.

    Args:
        sides: (CELLS, CELLS) side of the square number of points.
        centers: (H, W) pixels that hold the center of a Gaussian in view.

    Returns:
        (P, 2) x, y in [0, 1], cell by cell.
    """
    side = CELLS * PARTS
    held = np.bincount(_squares(centers.shape, side)[centers], minlength=side**2)
    parts = held.reshape(CELLS, PARTS, CELLS, PARTS).swapaxes(1, 2).reshape(CELLS**2, PARTS**2)
    # 1 more: a part without a center is drawn, too.
    chances = (parts + 1) / (parts + 1).sum(axis=1, keepdims=True)
    points = []
    for cell, count in enumerate(sides.ravel() ** 2):
        row, column = np.divmod(random.choice(PARTS**2, count, p=chances[cell]), PARTS)
        corner = np.stack([column + cell % CELLS * PARTS, row + cell // CELLS * PARTS], axis=1)
        points.append((corner + random.random((count, 2))) / side)
    return np.concatenate(points).astype(np.float32)


def _squares(shape: tuple[int, ...], side: int) -> NDArray[np.int64]:
    """(H, W) number of the square of each pixel, where ``side`` times ``side`` of them cover the image, row by row."""
    rows, columns = (np.arange(size) * side // size for size in shape)
    return rows[:, None] * side + columns
