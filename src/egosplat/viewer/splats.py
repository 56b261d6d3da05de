"""Gaussians drawn by the browser itself."""

from typing import TYPE_CHECKING

from egosplat.gaussians.model import rotation_matrices
from egosplat.viewer.pictures import Painted

if TYPE_CHECKING:
    from viser import ClientHandle, GaussianSplatHandle


def add_splats(client: "ClientHandle", painted: Painted) -> "GaussianSplatHandle":
    """Send Gaussians to a window, in colors that do not depend on the direction of view."""
    gaussians = painted.gaussians
    spread = rotation_matrices(gaussians.quats) * gaussians.scales[:, None]
    return client.scene.add_gaussian_splats(
        "/splats",
        centers=gaussians.means.cpu().numpy(),
        covariances=(spread @ spread.mT).cpu().numpy(),
        rgbs=painted.colors,
        opacities=gaussians.opacities[:, None].cpu().numpy(),
    )
