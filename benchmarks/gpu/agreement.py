"""Compare gsplat on a GPU with the reference in float64: images and gradients, in every mode that training and queries use."""

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from benchmarks.common import markdown
from egosplat.rasterize.api import rasterization

MODES = ("RGB", "RGB+ED")
RASTERIZE_MODES = ("classic", "antialiased")
# Standard deviation of the Gaussians [m], and their opacity, by name of the scene.
SCENES = {"small": (0.02, 0.5), "large": (0.2, 0.5), "opaque": (0.08, 0.99)}
COUNT, WIDTH, HEIGHT, FEATURES = 300, 96, 80, 5


def table(device: torch.device) -> str:
    """Largest differences on ``device`` as Markdown."""
    header = ["scene", "mode", "image", "alpha", "gradients, relative", "of"]
    return markdown(header, [list(row) for row in differences(device)])


def differences(device: torch.device) -> Iterator[tuple[str, str, str, str, str, str]]:
    """A row for each scene and mode."""
    for name, (scale, opacity) in SCENES.items():
        scene = make_scene(scale, opacity)
        for mode in MODES:
            for rasterize_mode in RASTERIZE_MODES:
                options = {"render_mode": mode, "rasterize_mode": rasterize_mode, "sh_degree": 3}
                wanted, wanted_alpha, by = rendered(scene, torch.device("cpu"), torch.float64, **options)
                image, alpha, found = rendered(scene, device, torch.float32, **options)
                relative = {
                    key: float((found[key] - by[key]).norm() / by[key].norm().clamp(min=1e-12)) for key in by
                }
                worst = max(relative, key=relative.__getitem__)
                yield (
                    name,
                    f"{mode}, {rasterize_mode}",
                    f"{float((image - wanted).abs().max()):.1e}",
                    f"{float((alpha - wanted_alpha).abs().max()):.1e}",
                    f"{relative[worst]:.1e}",
                    worst,
                )


def rendered(
    scene: dict[str, Tensor], device: torch.device, dtype: torch.dtype, **options: Any
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Image, alpha and the gradients of a weighted sum of both, in float64 on the CPU."""
    # One camera, as in training.
    leaves = {key: value.to(device, dtype).detach() for key, value in scene.items()}
    learned = [key for key in leaves if key not in ("viewmats", "Ks", "backgrounds")]
    for key in learned:
        leaves[key].requires_grad_()
    image, alpha, _ = rasterization(**leaves, width=WIDTH, height=HEIGHT, **options)
    generator = torch.Generator().manual_seed(1)
    v_image, v_alpha = (
        torch.rand(each.shape, generator=generator, dtype=torch.float64).to(device, dtype)
        for each in (image, alpha)
    )
    gradients = torch.autograd.grad(
        (image * v_image).sum() + (alpha * v_alpha).sum(), [leaves[key] for key in learned]
    )
    back = [each.detach().cpu().double() for each in (image, alpha, *gradients)]
    return back[0], back[1], dict(zip(learned, back[2:], strict=True))


def make_scene(scale: float, opacity: float) -> dict[str, Tensor]:
    """Random Gaussians in front of a camera, float64 on the CPU."""
    generator = torch.Generator().manual_seed(0)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    camera = torch.tensor([[80.0, 0, WIDTH / 2], [0, 80.0, HEIGHT / 2], [0, 0, 1]], dtype=torch.float64)
    return {
        "means": (uniform(COUNT, 3) - 0.5) * 2.0 + torch.tensor([0.0, 0.0, 3.0]),
        "quats": uniform(COUNT, 4) - 0.5,
        "scales": scale * (0.5 + uniform(COUNT, 3)),
        "opacities": opacity * (0.9 + 0.1 * uniform(COUNT)),
        "colors": uniform(COUNT, 16, 3) - 0.5,
        "features": uniform(COUNT, FEATURES),
        "viewmats": torch.eye(4, dtype=torch.float64)[None],
        "Ks": camera[None],
        "backgrounds": uniform(1, 3 + FEATURES),
    }
