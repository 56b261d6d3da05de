"""A scene that can be asked: Gaussians with what they mean, read from artifacts."""

from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.codes.decoder import Decoder, read_decoder
from egosplat.codes.rendering import Lens, lens_of
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians


@dataclass(frozen=True, eq=False)
class LanguageScene:
    """N Gaussians that mean something at L levels.

    Attributes:
        gaussians: on any device.
        code, share: (N, L, C) and (N, L) float32 of language.zarr, on the same device.
        decoder: of the codes.
        lens: how they are rendered.
    """

    gaussians: Gaussians
    code: Tensor
    share: Tensor
    decoder: Decoder
    lens: Lens


def read_scene(splats: Artifact, language: Artifact, features: Artifact, backend: str) -> LanguageScene:
    """Read what a query needs, onto the device of the backend.

    Args:
        splats, language, features: which belong together, see ``egosplat.artifacts.lineage.lineage``.
        backend: see ``egosplat.rasterize.api.rasterization``.

    Raises:
        UserError: the backend cannot run.
    """
    device = training_device(backend)
    return LanguageScene(
        gaussians=read_gaussians(splats).to(device),
        code=torch.from_numpy(language.read("code")).to(device),
        share=torch.from_numpy(language.read("share")).to(device),
        decoder=read_decoder(features),
        lens=lens_of(splats, backend),
    )
