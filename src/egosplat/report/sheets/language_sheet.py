"""Draw the codes of the Gaussians on one page: views through the recording, with the codes of each level as colors."""

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.drawing import empty_grid, plt, show
from egosplat.geometry import known_poses
from egosplat.images import evenly_spaced
from egosplat.language.rendering import render_codes
from egosplat.query.scene import read_trained_scene, rendering_camera
from egosplat.report.sheets.sheet import sheet

# Maximum number of views, and maximum side of a rendered one [px].
VIEWS, LONGEST_SIDE = 6, 512

# Width of an image on the page [inches].
CELL = 2.9

# Gray level, 0..1, of pixels without a code.
UNKNOWN = 0.25

# Range of the colors, in standard deviations on either side of the mean.
SPREAD = 2.0


@sheet("language")
@torch.no_grad()
def run(poses: Artifact, splats: Artifact, language: Artifact) -> tuple[Figure, str]:
    """Draw views through the recording, with the codes of each level as colors."""
    scene, levels = read_trained_scene(splats, "auto"), language.facts["levels"]
    camera, camera_to_world = rendering_camera(scene.camera, LONGEST_SIDE), camera_poses(poses, splats)
    size = (CELL * VIEWS, (CELL * camera.height / camera.width + 0.25) * (1 + len(levels)) + 0.9)
    figure = plt.figure(figsize=size, layout="constrained")
    code, share = language.read("code"), language.read("share")
    # Three numbers of a Gaussian are rendered in place of its code.
    colors = torch.from_numpy(code_colors(code, share)).to(scene.gaussians.means.device)
    shares = torch.from_numpy(share).to(colors.device)
    known = known_poses(camera_to_world)
    frames = known[evenly_spaced(len(known), VIEWS)]
    for column, frame in zip(empty_grid(figure, 1 + len(levels), VIEWS).T, frames, strict=False):
        pose = camera_to_world[frame]
        show(column[0], scene.picture(camera, pose), f"as in frame {frame}")
        rendered = render_codes(scene.gaussians, colors, shares, camera, pose, scene.settings)
        of_levels = (values.cpu().numpy() for values in rendered)
        for axes, name, painted, coverage in zip(column[1:], levels, *of_levels, strict=True):
            show(axes, blend(painted, coverage), f"{name}: {coverage.mean():.0%} covered by codes")
    return figure, (
        f"language codes of the Gaussians ({language.facts['method']}), origin {language.origin}\n"
        "views of the recording: rendered colors, and codes of each level; similar colors are similar features; "
        "dark gray: no code, because no training view shows an instance"
    )


def blend(colors: NDArray[np.floating], coverage: NDArray[np.float32]) -> NDArray[np.float64]:
    """(..., 3) colors, clipped to [0, 1], blended with gray where the (...) coverage is below 1."""
    share = np.clip(coverage, 0.0, 1.0)[..., None]
    return share * np.clip(colors, 0.0, 1.0) + (1 - share) * UNKNOWN


def code_colors(code: NDArray[np.float32], share: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, L, 3) colors of (N, L, C) codes by their first three principal components over all levels, weighted by (N, L) shares.

    They are not clipped: 0.5 is the mean of all codes, and the color of a mean of codes is the mean of their colors.
    """
    values, weight = code.reshape(-1, code.shape[2]).astype(np.float64), share.ravel().astype(np.float64)
    weight /= max(weight.sum(), np.finfo(float).tiny)
    mean = weight @ values
    variance, vectors = np.linalg.eigh(((values - mean) * weight[:, None]).T @ (values - mean))
    colors = np.full((*share.shape, 3), 0.5, np.float32)
    for channel, (value, vector) in enumerate(zip(variance[:-4:-1], vectors.T[::-1], strict=False)):
        if value > 1e-9 * max(variance[-1], 1e-9):
            # The sign of an eigenvector is arbitrary. Making its largest entry positive keeps colors reproducible.
            vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
            colors[..., channel] += (code - mean) @ vector / (2 * SPREAD * np.sqrt(value))
    return colors
