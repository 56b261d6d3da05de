"""Render things into frames as label maps."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse

from egosplat.codes.rendering import render_values
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.geometry import Camera

LEAST_BELIEF = 0.05


def render_things(
    gaussians: Gaussians,
    beliefs: sparse.csr_array,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
    size: tuple[int, int],
) -> NDArray[np.int32]:
    """Label each pixel with the strongest thing.

    Args:
        gaussians: geometry of the scene.
        beliefs: (N, K), see ``things.beliefs``.
        camera, camera_to_world: of the frame, at the working size.
        settings: render settings.
        size: height and width of the label map.

    Returns:
        (H, W) int32, -1 where no thing is.
    """
    best = torch.full(size, LEAST_BELIEF)
    labels = torch.full(size, -1, dtype=torch.int32)
    count = beliefs.shape[1]
    for first in range(0, count, 64):
        some = torch.from_numpy(beliefs[:, first : first + 64].toarray())
        image, _ = render_values(gaussians, some, camera, camera_to_world, settings)
        # Most things are outside the frame, and enlarging their images would take most of the time.
        in_frame = torch.nonzero(image.amax((0, 1)) > LEAST_BELIEF)[:, 0]
        if len(in_frame):
            images = image.permute(2, 0, 1)[in_frame][None]
            highest, which = torch.nn.functional.interpolate(images, size, mode="bilinear")[0].max(0)
            better = highest > best
            best = torch.where(better, highest, best)
            labels = torch.where(better, in_frame[which].int() + first, labels)
    return labels.numpy()
