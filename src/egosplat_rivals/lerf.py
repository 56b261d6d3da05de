"""Method ``train_field``: LERF (Kerr et al., ICCV 2023). A field of features by position and scale, over the Gaussians' surfaces."""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.schemas import TILES
from egosplat.features.compression import fit_linear
from egosplat.language.decoder import Decoder
from egosplat.language.lifting import shares
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.views import CodeViews
from egosplat_rivals.hash_grid import FEATURES, RESOLUTIONS, HashGrid, contract
from egosplat_rivals.loop import Layers, Step, Trainee, fewer_iterations, train
from egosplat_rivals.surface import surface_depths
from egosplat_rivals.tile_views import TileViews, nearest

# Published: hidden layers of the features' and the regulariser's network, the learning rate and where it ends, decay,
# iterations, and the largest scale of a query.
HIDDEN, REGULARISED = (256, 256, 256, 256), (256,)
_FIRST_RATE, _LAST_RATE, _RATE_STEPS = 1e-2, 1e-3, 4000
_DECAY, _EPSILON, _ITERATIONS = 1e-9, 1e-15, 30_000
LARGEST_SCALE = 1.5

# Published: weight of the features' loss, and where Huber's loss turns linear.
FEATURE_WEIGHT, _HUBER = 0.1, 1.25

# Weight of the regulariser's squared error, our choice: sums over DINO's 384 raw channels would drown the features.
REGULARISER_WEIGHT = 1e-3

# Values of the widest layer that are held while the field is evaluated at all Gaussians.
_ROWS_AT_ONCE = 2**14

# Scales at which the field is stored, from 0 to LARGEST_SCALE, each a level, of which LERF asks 30; and numbers of a code, a
# linear basis of the field's features. LERF has no codes.
SCALES, CHANNELS = 8, 32


def train_field(
    views: CodeViews, tiles: TileViews, options: LanguageOptions, checkpoint: Checkpoint
) -> Coded:
    """Train the field at the depths that the Gaussians show, then evaluate it at their centers, at several scales.

    UserError if a view has no tiles, or training diverges.
    """
    tiles.check_has(views.frame)
    trained = Field(views, tiles, options)
    curve = train(trained, len(views), options.iterations, options.seed, checkpoint)
    scales = torch.linspace(0.0, LARGEST_SCALE, SCALES, device=views.device)
    code, decoder = evaluate_at_centers(trained, views.gaussians.means, scales, CHANNELS)
    share = shares(views)
    stands_in = (
        tiles.stands_in + f", with the weight {REGULARISER_WEIGHT:g}" * bool(tiles.components),
        *fewer_iterations(options.iterations, _ITERATIONS),
        f"{options.pixels:,} rays of one view an iteration",
        "one sample a ray, at the depth of the shared geometry, not nerfacto's 24",
        f"{SCALES} scales of a query for 30, and codes of {CHANNELS} numbers in a linear basis",
        "a grid of an eighth of the entries, trained by sparse Adam in place of RAdam",
    )
    levels = [f"scale {scale:.2f}" for scale in scales.tolist()]
    # A field has no Gaussians; it is trained on the surfaces that pixels show, beside which centers lie.
    return Coded(code, share.repeat(1, len(levels)), levels, decoder, curve, stands_in, maps_only=True)


def center_and_unit(positions: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(3,) mean of (V, 3) cameras, which the field sees at 0, and their largest coordinate, 1 there [m]; 1 m for one place."""
    center = positions.mean(axis=0)
    most = float(np.abs(positions - center).max())
    # In proportion, because the world may be in any unit.
    return center, most if most > 1e-9 * float(np.abs(positions).max()) else 1.0


def learning_rate(iteration: int) -> float:
    """The rate of an iteration, which falls by a factor each, then stays."""
    return _FIRST_RATE * math.exp(math.log(_LAST_RATE / _FIRST_RATE) * min(iteration / _RATE_STEPS, 1.0))


def feature_loss(found: Tensor, wanted: Tensor) -> Tensor:
    """() weighted mean over rays of the sum over channels of Huber's loss between (P, D) features; 0 without rays."""
    return FEATURE_WEIGHT * F.huber_loss(found, wanted, reduction="sum", delta=_HUBER) / max(1, len(found))


def input_scale(scale: Tensor, distance: Tensor, height: int, focal: float) -> Tensor:
    """(P,) input of the field for a scale of 0 to 1 seen from a distance, in units of the field's world."""
    return scale * height * distance / focal


class Field(Trainee):
    """Features by position and scale, from a grid of positions; and a regulariser by position, or None."""

    def __init__(self, views: CodeViews, tiles: TileViews, options: LanguageOptions) -> None:
        """Start from random weights."""
        super().__init__(views, options)
        width, seed, cpu = len(RESOLUTIONS) * FEATURES, options.seed, torch.device("cpu")
        self.grid = HashGrid(torch.Generator().manual_seed(seed))
        self.features = Layers((width + 1, *HIDDEN, tiles.channels), seed, cpu)
        self.regulariser = None
        if tiles.components:
            self.regulariser = Layers((width, *REGULARISED, tiles.components), seed + 1, cpu)
        self.to(views.device)
        networks = [part for name, part in self.named_parameters() if not name.startswith("grid")]
        self.optimizers = [
            torch.optim.SparseAdam([self.grid.table], lr=_FIRST_RATE, eps=_EPSILON),
            torch.optim.RAdam(networks, lr=_FIRST_RATE, eps=_EPSILON, weight_decay=_DECAY),
        ]
        center, self._unit = center_and_unit(views.camera_to_world[:, :3, 3])
        self._center, self._tiles = torch.from_numpy(center).to(views.device, torch.float32), tiles

    def forward(self, points: Tensor, scale: Tensor) -> Tensor:
        """Return (P, D) features of unit norm at (P, 3) points [m] and (P,) scales."""
        return self._features(self._hashed(points), scale)

    def loss(self, step: Step) -> Tensor:
        """Return the loss of the features, and of the regulariser, of the rays of one view."""
        for optimizer in self.optimizers:
            optimizer.param_groups[0]["lr"] = learning_rate(step.iteration)
        pixels, _ = self.draw_pixels(step)
        points, distance, shown = self._surface(step.view, pixels)
        pixels = pixels[shown]
        number = torch.randint(len(self._tiles.scales) - 1, (len(pixels),), generator=step.draw)
        part = torch.rand(len(pixels), generator=step.draw)
        frame, camera = self.frame(step.view), self.views.camera
        wanted = self._tiles.between(frame, pixels, number, part)
        scale = (number + part) / (len(self._tiles.scales) - 1)
        hashed = self._hashed(points)
        sigma = input_scale(scale, distance / self._unit, camera.height, camera.fy).to(hashed)
        loss = feature_loss(self._features(hashed, sigma), wanted.to(hashed))
        if self.regulariser is None:
            return loss
        image = nearest(self._tiles.regulariser(frame), pixels, camera.width, camera.height)
        error = (self.regulariser(hashed) - image.to(hashed)).square().sum() / max(1, len(points))
        return loss + REGULARISER_WEIGHT * error

    def _hashed(self, points: Tensor) -> Tensor:
        return self.grid(contract((points - self._center) / self._unit))

    def _features(self, hashed: Tensor, scale: Tensor) -> Tensor:
        return F.normalize(self.features(torch.cat([hashed, scale[:, None]], dim=1)), dim=-1)

    def _surface(self, view: int, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The points [m] at the median depth of pixels, their distances from the camera [m], and which pixels have one."""
        camera, depth = self.views.camera, surface_depths(self.views, view, pixels)
        seen = depth.isfinite()
        at = pixels[seen].double() + 0.5
        focal, middle = torch.tensor([camera.fx, camera.fy]), torch.tensor([camera.cx, camera.cy])
        rays = torch.cat([(at - middle) / focal, at.new_ones(len(at), 1)], dim=1) * depth[seen, None]
        to_world = torch.from_numpy(self.views.camera_to_world[view])
        points = rays @ to_world[:3, :3].T + to_world[:3, 3]
        return points.to(self.views.gaussians.means), rays.norm(dim=1).float(), seen


@torch.no_grad()
def evaluate_at_centers(
    trained: Field, means: Tensor, scales: Tensor, channels: int
) -> tuple[Tensor, Decoder]:
    """Evaluate a field at (N, 3) centers of Gaussians [m] and (S,) scales: (N, S, C) codes of a linear basis, and their decoder."""
    rows = [
        torch.stack([trained(part, scale.expand(len(part))) for scale in scales], dim=1)
        for part in means.split(_ROWS_AT_ONCE)
    ]
    few = torch.cat([part[:: max(1, len(rows))] for part in rows]).flatten(0, 1)
    basis = fit_linear(few.cpu().numpy(), channels)
    code = torch.cat([torch.from_numpy(basis.encode(part.flatten(0, 1).cpu().numpy())) for part in rows])
    return code.unflatten(0, (len(means), len(scales))).to(means.device), basis.decoder


METHOD = Method(train_field, (TILES,), TileViews)
