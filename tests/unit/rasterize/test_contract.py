"""Validation of the arguments: documented shapes pass, others are reported with their shape."""

import math

import pytest
import torch

from egosplat.rasterize.contract import Arguments, check


def arguments(n: int = 4, c: int = 2, **changes: object) -> dict[str, object]:
    return {
        "means": torch.zeros(n, 3),
        "quats": torch.zeros(n, 4),
        "scales": torch.zeros(n, 3),
        "opacities": torch.zeros(n),
        "colors": torch.zeros(n, 3),
        "viewmats": torch.eye(4).repeat(c, 1, 1),
        "Ks": torch.eye(3).repeat(c, 1, 1),
        "width": 8,
        "height": 6,
    } | changes


@pytest.mark.parametrize(
    "accepted",
    [
        {},
        {"n": 0},
        {"colors": torch.zeros(4, 7)},
        {"colors": torch.zeros(4, 0), "features": torch.zeros(4, 2)},
        {"features": torch.zeros(4, 0)},
        {"features": torch.zeros(4, 9), "backgrounds": torch.zeros(2, 12)},
        {"colors": torch.zeros(4, 1, 3), "sh_degree": 0},
        {"colors": torch.zeros(4, 16, 3), "sh_degree": 1, "backgrounds": torch.zeros(2, 3)},
        {"means": torch.full((4, 3), math.nan)},
        {"render_mode": "RGB+ED", "rasterize_mode": "antialiased"},
        {"far_plane": math.inf},
    ],
    ids=str,
)
def test_valid_shapes_are_accepted(accepted):
    check(Arguments(**arguments(**accepted)))


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        ({"means": torch.zeros(4, 2)}, r"means has shape \(4, 2\), not \(4, 3\)"),
        *(({name: torch.tensor(1.0)}, rf"{name} has shape \(\)") for name in ("means", "features")),
        ({"quats": torch.zeros(4, 3)}, r"quats has shape \(4, 3\), not \(4, 4\)"),
        ({"scales": torch.zeros(5, 3)}, r"scales has shape \(5, 3\)"),
        ({"opacities": torch.zeros(4, 1)}, r"opacities has shape \(4, 1\)"),
        ({"colors": torch.zeros(3, 3)}, r"colors has shape \(3, 3\)"),
        ({"colors": torch.zeros(4, 4, 3)}, r"colors has shape \(4, 4, 3\), not \(4, D\)"),
        ({"colors": torch.zeros(4, 0)}, "no channel"),
        ({"colors": torch.zeros(4, 3), "sh_degree": 0}, r"colors has shape \(4, 3\)"),
        ({"colors": torch.zeros(4, 4, 3), "sh_degree": 2}, r"K one of \[9, 16\]"),
        ({"colors": torch.zeros(4, 10, 3), "sh_degree": 2}, r"shape \(4, 10, 3\)"),
        *(({"colors": torch.zeros(4, 4, 3), "sh_degree": d}, f"sh_degree is {d}") for d in (4, -1, True)),
        ({"features": torch.zeros(3, 2)}, r"features has shape \(3, 2\)"),
        ({"backgrounds": torch.zeros(3)}, r"backgrounds has shape \(3,\), not \(2, 3\)"),
        ({"backgrounds": torch.zeros(2, 3), "features": torch.zeros(4, 1)}, r"not \(2, 4\)"),
        *((a, "not finite|whole") for a in ({"backgrounds": torch.full((2, 3), math.nan)}, {"width": 8.0})),
        ({"near_plane": "0.1"}, "not a number"),
        ({"quats": [[1.0] * 4] * 4}, "not a tensor"),
        ({"c": 0}, "at least one camera"),
        ({"viewmats": torch.zeros(2, 3, 4)}, r"viewmats has shape \(2, 3, 4\)"),
        ({"Ks": torch.eye(3)[None]}, r"Ks has shape \(1, 3, 3\)"),
        ({"Ks": torch.tensor([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]).repeat(2, 1, 1)}, "skew"),
        ({"means": torch.zeros(4, 3).half()}, "float16"),
        ({"quats": torch.zeros(4, 4).double()}, "quats is torch.float64"),
        ({"features": torch.zeros(4, 1, device="meta")}, "features is torch.float32 on meta"),
        ({"radius_clip": -1.0}, "radius_clip -1.0"),
        ({"render_mode": "RGBD"}, "'RGBD', not one of RGB, D, ED"),
        ({"rasterize_mode": "smooth"}, "'smooth', not one of classic"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_invalid_shapes_are_rejected(refused, words):
    with pytest.raises(ValueError, match=words):
        check(Arguments(**arguments(**refused)))
