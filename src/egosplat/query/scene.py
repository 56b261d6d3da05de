"""Read trained scenes: Gaussians with their render settings, and the codes that queries need."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import PIXELS
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder, read_scene_decoder
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.text import Texts


@dataclass(frozen=True, eq=False)
class TrainedScene:
    """N trained Gaussians.

    Attributes:
        gaussians: on any device.
        camera: camera of the training views.
        sh_degree: degree of the spherical harmonics in use.
    """

    gaussians: Gaussians
    settings: RenderSettings
    camera: Camera
    sh_degree: int

    @torch.no_grad()
    def picture(self, camera: Camera, camera_to_world: NDArray[np.float64]) -> NDArray[np.float32]:
        """Render (H, W, 3) float32 sRGB in [0, 1] as in training; a random background becomes black."""
        image, _, _ = render(
            self.gaussians,
            camera,
            camera_to_world,
            self.settings,
            sh_degree=self.sh_degree,
            background=self.settings.still_background,
        )
        return image.clamp(0.0, 1.0).cpu().numpy()


@dataclass(frozen=True, eq=False)
class QueryScene(TrainedScene):
    """A trained scene whose Gaussians have codes at L levels.

    Attributes:
        code, share: (N, L, C) and (N, L) float32 of language.zarr, on the Gaussians' device.
        decoder: from codes to features.
        decoded: what queries of a view decode, see ``egosplat.artifacts.schemas``.
        levels: names of the levels.
    """

    code: Tensor
    share: Tensor
    decoder: Decoder
    decoded: str
    levels: Sequence[str]

    def relevancy(self, texts: Texts, temperature: float) -> Tensor:
        """Relevancy of each Gaussian's own code to all queries.

        Args:
            temperature: see ``egosplat.query.relevancy.relevancy``.

        Returns:
            (Q, L, N) float32 in [0, 1] on the Gaussians' device; 0 without a code.
        """
        # An image of one level, with a row for each Gaussian and a column for each of its codes, as they lie in memory.
        maps = relevancy_maps(self.code[None], self.share[None] > 0, self.decoder, texts, temperature)
        return maps[:, 0].transpose(1, 2).contiguous()


def read_trained_scene(splats: Artifact, backend: str) -> TrainedScene:
    """Read the Gaussians onto the device of the backend.

    Args:
        backend: see ``egosplat.rasterize.api.rasterization``.

    Raises:
        UserError: the backend cannot run.
    """
    return TrainedScene(
        gaussians=read_gaussians(splats).to(training_device(backend)),
        settings=read_render_settings(splats, backend),
        camera=Camera(**splats.facts["camera"]),
        sh_degree=splats.facts["sh_degree_in_use"],
    )


def read_scene(splats: Artifact, language: Artifact, features: Artifact, backend: str) -> QueryScene:
    """Read what a query needs, onto the device of the backend.

    Args:
        splats, language, features: artifacts that belong together, see ``egosplat.artifacts.lineage.lineage``. Tiles in place
            of features, if the codes were learnt from them.
        backend: see ``egosplat.rasterize.api.rasterization``.

    Raises:
        UserError: the backend cannot run.
    """
    trained = read_trained_scene(splats, backend)
    device = trained.gaussians.means.device
    return QueryScene(
        **vars(trained),
        code=torch.from_numpy(language.read("code")).to(device),
        share=torch.from_numpy(language.read("share")).to(device),
        decoder=read_scene_decoder(language, features),
        decoded=language.facts.get("decoded", PIXELS),
        levels=language.facts["levels"],
    )


def rendering_camera(camera: Camera, resolution: int) -> Camera:
    """Scale a camera down to a longer side of ``resolution`` [px]; 0, or more than its own, changes nothing."""
    longer = max(camera.width, camera.height)
    # Codes have no more detail than the frames that they were trained on.
    if not 0 < resolution < longer:
        return camera
    width, height = (max(1, round(side * resolution / longer)) for side in (camera.width, camera.height))
    return camera.scaled_to(width, height)
