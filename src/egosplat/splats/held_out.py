"""Score the Gaussians on held-out frames, and write renders and scores."""

from egosplat.artifacts.writer import Writer
from egosplat.gaussians.evaluation import Scores, evaluate
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.training_views import Views


def put_held_out(
    artifact: Writer,
    gaussians: Gaussians,
    held_out: Views,
    settings: RenderSettings,
    sh_degree: int,
    suffix: str = "",
) -> Scores:
    """Render the held-out frames and store the renders and their scores; ``suffix`` ends the names of the arrays."""
    camera, render = held_out.camera, f"held_out/render{suffix}"
    artifact.allocate(render, (len(held_out), camera.height, camera.width, 3))
    scores = evaluate(
        gaussians,
        held_out,
        settings,
        sh_degree,
        lambda index, picture: artifact.put_row(render, index, picture),
    )
    artifact.put(f"held_out/psnr{suffix}", scores.psnr)
    artifact.put(f"held_out/ssim{suffix}", scores.ssim)
    return scores
