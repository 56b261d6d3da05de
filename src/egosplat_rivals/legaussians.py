"""Method ``train_indices``: LEGaussians (Shi et al., CVPR 2024). Dense features become indices into a codebook."""

import math
from functools import cached_property

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.schemas import TILES
from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.language.lifting import shares
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.views import CodeViews
from egosplat.progress import track
from egosplat_rivals.loop import Layers, Step, Trainee, adam, fewer_iterations, train
from egosplat_rivals.tile_views import TileViews, nearest

# Published: numbers of a code, hidden layers of its decoder, and layers of the network of positions; learning rates of codes,
# of their uncertainty and of networks, decay of the decoder, and iterations; uncertainty at the start, iterations from one
# smoothing to the next, and its weight at no uncertainty.
CHANNELS, HIDDEN = 8, (128, 256)
POSITIONS = (3, 128, 128, 128, 128, CHANNELS)
_CODE_RATE, _UNCERTAINTY_RATE, _LAYER_RATE, _DECAY, _ITERATIONS = 1e-3, 0.05, 1e-3, 1e-5, 30_000
_UNCERTAIN, _SMOOTH_EVERY, LEAST_SMOOTHING = 0.01, 10, 0.1

# Features of the codebook's training that are held: 100 MiB at 192 channels, a third of those of 100 views.
_POOL = 2**17

# Keeps the logarithm finite where rendered uncertainty is 1.
_MOST_UNCERTAIN = 1 - 1e-6

# Published, of features: scales that are mixed, what their sum is divided by, and rows of the map. Of the codebook: words,
# images in a batch, passes over all images, weights of the regulariser's half and of the even use of words, learning rate
# and decay. The rate falls to a tenth over 1,000 passes.
MIXED, _DIVISOR, ROWS = 6, 7, 60
WORDS, _BATCH, _EPOCHS = 128, 32, 300
REGULARISER, _EVEN = 0.5, 1.0
_WORD_RATE, _WORD_DECAY, _LAST, _PASSES = 1e-4, 0.01, 0.1, 1000


def train_indices(
    views: CodeViews, tiles: TileViews, options: LanguageOptions, checkpoint: Checkpoint
) -> Coded:
    """Train the codebook, then codes with the decoder of indices; the curve has both (UserError: no tiles, or it diverges)."""
    tiles.check_has(views.frame)
    codes = QuantizedCodes(views, tiles, options)
    curve = train(codes, len(views), codes.first_phase + options.iterations, options.seed, checkpoint)
    share = shares(views)
    stands_in = (
        tiles.stands_in,
        *fewer_iterations(options.iterations, _ITERATIONS),
        f"the loss of {options.pixels:,} pixels of a view, and of as many features a batch",
        "color and geometry fixed, not trained along with it",
    )
    # Codes start at random, and only their blends are trained: that of one Gaussian is mostly its start.
    code = codes.code.detach()[:, None]
    return Coded(code, share, ["quantized"], codes.stored(), curve, stands_in, maps_only=True)


def uncertain_loss(entropy: Tensor, uncertainty: Tensor) -> Tensor:
    """() mean of (P,) ``entropy (1 - u) - log(1 - u)`` with u in [0, 1); gradients reach both. 0 without pixels."""
    sure = 1 - uncertainty.clamp(max=_MOST_UNCERTAIN)
    return (entropy * sure - sure.log()).sum() / max(1, len(entropy))


def smoothing(codes: Tensor, predicted: Tensor, uncertainty: Tensor) -> Tensor:
    """() two terms: the prediction follows the codes, and codes follow the prediction, the more the less certain.

    Codes and their prediction from positions are (S, C); the (S,) uncertainty of the Gaussians gets no gradient.
    """
    weight = LEAST_SMOOTHING * (1 - uncertainty.detach()) + uncertainty.detach()
    fit = (predicted - codes.detach()).square().mean()
    return fit + (weight * (predicted.detach() - codes).square().mean(dim=1)).mean()


class QuantizedCodes(Trainee):
    """A codebook for ``first_phase`` iterations, then codes, (N, 8), with (N,) logits of their uncertainty.

    ``decoder`` is from codes to logits of the words, ``positions`` from positions to codes, for smoothness.
    """

    def __init__(self, views: CodeViews, tiles: TileViews, options: LanguageOptions) -> None:
        """Start from random numbers."""
        super().__init__(views, options)
        count, device, seed = views.gaussians.count, views.device, options.seed
        draw = torch.Generator().manual_seed(seed)
        self.code = nn.Parameter(torch.randn(count, CHANNELS, generator=draw).to(device))
        start = math.log(_UNCERTAIN / (1 - _UNCERTAIN))
        self.uncertainty = nn.Parameter(torch.full((count,), start, device=device))
        self.codebook = Codebook(tiles.channels, tiles.components, draw).to(device)
        widths = (CHANNELS, *HIDDEN, len(self.codebook.words))
        self.decoder = Layers(widths, seed, device, unit_input=True)
        self.positions = Layers(POSITIONS, seed, device)
        self.optimizers = [
            self.codebook.optimizer,
            adam([([self.code], _CODE_RATE), ([self.uncertainty], _UNCERTAINTY_RATE)]),
            torch.optim.AdamW([self.decoder.values], lr=_LAYER_RATE, weight_decay=_DECAY),
            torch.optim.AdamW([self.positions.values], lr=_LAYER_RATE),
        ]
        self._tiles = tiles
        self._indices: dict[int, Tensor] = {}
        self.first_phase = _EPOCHS * math.ceil(len(views) / _BATCH)

    def loss(self, step: Step) -> Tensor:
        """Return the codebook's loss in the first phase, then that of the codes."""
        if step.iteration <= self.first_phase:
            chosen = torch.randint(len(self._pool), (self.pixels,), generator=step.draw)
            self.codebook.set_rate(step.iteration * _EPOCHS / self.first_phase)
            return self.codebook.loss(self._pool[chosen].to(self.code.device))
        pixels, weight = self.draw_pixels(step)
        values = torch.cat([self.code, self.uncertainty.sigmoid()[:, None]], dim=1)
        codes, uncertainty = self.render(step.view, pixels, values).split([CHANNELS, 1], dim=1)
        entropy = F.cross_entropy(self.decoder(codes), self._index(step.view, pixels), reduction="none")
        loss = uncertain_loss(entropy * weight, uncertainty[:, 0])
        return loss + self._smoothing(step.draw) if step.iteration % _SMOOTH_EVERY == 0 else loss

    def stored(self) -> Decoder:
        """From codes to features: the words, as long as they are, weighted by the softmax of the logits."""
        decoder, words = self.decoder.trained(), self.codebook.words.detach().cpu()[:, : self._tiles.channels]
        values = [torch.from_numpy(decoder.values), words.T.reshape(-1), torch.zeros(words.shape[1])]
        after = ("relu",) * len(HIDDEN) + ("softmax", "none")
        return Decoder((*decoder.widths, words.shape[1]), torch.cat(values).numpy(), after, unit_input=True)

    @cached_property
    def _pool(self) -> Tensor:
        """(R, D + K) features of all views, about ``_POOL`` of them. They are equal after a kill."""
        draw, count = torch.Generator().manual_seed(0), len(self.views)
        few, rows = max(1, _POOL // count), []
        for view in track(range(count), "mixing tiles", unit="view"):
            features = dense_features(self._tiles, self.frame(view), self.views.camera).flatten(0, 1)
            rows.append(features[torch.randperm(len(features), generator=draw)[:few]])
        return torch.cat(rows)

    @torch.no_grad()
    def _index(self, view: int, pixels: Tensor) -> Tensor:
        """(P,) index of the word at each pixel. A view's are kept, because words do not change after the first phase."""
        camera = self.views.camera
        if view not in self._indices:
            features = dense_features(self._tiles, self.frame(view), camera).to(self.code.device)
            self._indices[view] = self.codebook.indices(features.flatten(0, 1)).view(features.shape[:2])
        return nearest(self._indices[view], pixels.to(self.code.device), camera.width, camera.height)

    def _smoothing(self, draw: torch.Generator) -> Tensor:
        means = self.views.gaussians.means
        chosen = torch.randint(len(means), (self.pixels,), generator=draw)
        predicted = self.positions(means[chosen])
        return smoothing(self.code[chosen], predicted, self.uncertainty[chosen].sigmoid())


def mixture(tiles: list[Tensor]) -> Tensor:
    """(rows, columns, D) sum of the first six of (rows, columns, D) scales at the first's grid, divided by seven."""
    rows, columns, _ = tiles[0].shape
    grids = torch.stack([_resized(tile.float(), rows, columns) for tile in tiles[:MIXED]])
    return grids.sum(dim=0).movedim(0, -1) / _DIVISOR


def _resized(image: Tensor, rows: int, columns: int) -> Tensor:
    """(C, rows, columns) nearest of (h, w, C)."""
    return F.interpolate(image.movedim(-1, 0)[None], (rows, columns), mode="nearest")[0]


def dense_features(tiles: TileViews, frame: int, camera: Camera) -> Tensor:
    """(60, columns, D + K) features of a frame: the mixture of its tiles, and the regulariser; the pixels are square."""
    parts = [mixture([tiles.read(frame, number) for number in range(MIXED)])]
    if (regulariser := tiles.regulariser(frame)) is not None:
        parts.append(regulariser)
    columns = max(1, round(ROWS * camera.width / camera.height))
    return torch.cat([_resized(image, ROWS, columns) for image in parts]).movedim(0, -1)


class Codebook(nn.Module):
    """Words, (128, D + K), for features of two halves, each compared by direction, and their optimizer."""

    def __init__(self, channels: int, components: int, draw: torch.Generator) -> None:
        """Start from random words of ``channels`` D and ``components`` K, 0 without a regulariser."""
        super().__init__()
        values = (2 * torch.rand(WORDS, channels + components, generator=draw) - 1) / WORDS
        self.words = nn.Parameter(values)
        self.optimizer = torch.optim.AdamW([self.words], lr=_WORD_RATE, weight_decay=_WORD_DECAY)
        self._sizes = [channels, components]

    def likeness(self, features: Tensor) -> Tensor:
        """(R, 128) cosine of the first halves, plus the weighted cosine of the regulariser's."""
        halves = zip(features.split(self._sizes, 1), self.words.split(self._sizes, 1), strict=True)
        cosines = [F.normalize(rows, dim=1) @ F.normalize(words, dim=1).T for rows, words in halves]
        return cosines[0] + REGULARISER * cosines[1]

    def indices(self, features: Tensor) -> Tensor:
        """(R,) the word most like each feature."""
        return self.likeness(features).argmax(dim=1)

    def loss(self, features: Tensor) -> Tensor:
        """() distance from the chosen words, plus a term that is least if all words are chosen alike."""
        likeness, most = self.likeness(features), 1 + (REGULARISER if self._sizes[1] else 0)
        return most - likeness.amax(dim=1).mean() + _EVEN * even_use(likeness)

    def set_rate(self, passes: float) -> None:
        """Set the learning rate after a number of passes over all images."""
        part = min(passes / _PASSES, 1.0)
        self.optimizer.param_groups[0]["lr"] = _WORD_RATE * (1 - (1 - _LAST) * part)


def even_use(likeness: Tensor) -> Tensor:
    """() sum over words of the share of (R, W) rows that choose it times its mean softmax; 1 / W if all are used alike."""
    share = likeness.argmax(dim=1).bincount(minlength=likeness.shape[1]) / max(1, len(likeness))
    return (share * likeness.softmax(dim=1).mean(dim=0)).sum()


METHOD = Method(train_indices, (TILES,), TileViews)
