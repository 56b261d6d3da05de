"""Read and write Gaussians and training curves of an artifact."""

import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.writer import Writer
from egosplat.errors import UserError
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.render import BACKGROUNDS, RenderSettings, TrainedScene
from egosplat.gaussians.trainer import Curves
from egosplat.geometry import Camera
from egosplat.rasterize.api import training_device


def put_gaussians(artifact: Writer, gaussians: Gaussians) -> None:
    """Store the parameters without Gaussians that are not finite, which no image shows; UserError if none is finite."""
    whole = gaussians.finite()
    if not whole.any():
        raise UserError("splats: training left no finite Gaussian; raise run.near_plane")
    kept = gaussians.detach().select(whole)
    for name in PARAMETERS:
        artifact.put(name, getattr(kept, name).cpu().numpy())


def read_gaussians(artifact: Artifact, prefix: str = "") -> Gaussians:
    """Read the Gaussians of an artifact to the CPU, without gradients; ``prefix`` begins the names of its arrays."""
    names = [name for name in PARAMETERS if name != "features"]
    stored = {name: torch.from_numpy(artifact.read(f"{prefix}{name}")) for name in names}
    # Features are the codes of joint training. Without channels here, no render composites them.
    return Gaussians(**stored, features=torch.zeros(len(stored["means"]), 0))


def put_curves(artifact: Writer, curves: Curves) -> None:
    """Store the training curves, without the seconds, which differ between identical runs."""
    artifact.put("curve/iteration", np.array(curves.iteration, np.int64))
    artifact.put("curve/loss", np.array(curves.loss, np.float64))
    artifact.put("curve/gaussians", np.array(curves.gaussians, np.int64))
    artifact.put("history/iteration", np.array(curves.evaluated, np.int64))
    artifact.put("history/psnr", np.array(curves.psnr, np.float64))
    artifact.put("history/ssim", np.array(curves.ssim, np.float64))


def read_exposure(splats: Artifact) -> tuple[Tensor | None, Tensor | None]:
    """Read the (F, 3) logarithms of the gains of all frames, and the (1,) compression of highlights; None if neither is corrected."""
    if not splats.has("corrections/gain"):
        return None, None
    compression = torch.tensor([splats.facts["highlight_compression"]], dtype=torch.float64)
    return torch.from_numpy(splats.read("corrections/gain")).log(), compression


def read_render_settings(artifact: Artifact, backend: str) -> RenderSettings:
    """Return the settings that a splats artifact was trained with, with the given backend."""
    options = artifact.provenance["options"]
    background = options.get("background") or BACKGROUNDS[options["recipe"]]  # 0.2 had a key for it
    return RenderSettings(options["near_plane"], background, backend)


def read_trained_scene(splats: Artifact, backend: str) -> TrainedScene:
    """Read the Gaussians onto the device of a backend of ``egosplat.rasterize`` (UserError: it cannot run)."""
    return TrainedScene(
        gaussians=read_gaussians(splats).to(training_device(backend)),
        settings=read_render_settings(splats, backend),
        camera=Camera(**splats.facts["camera"]),
        sh_degree=splats.facts["sh_degree_in_use"],
    )
