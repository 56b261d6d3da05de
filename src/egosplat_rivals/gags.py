"""Method ``train_granular``: the distillation of GAGS (Peng et al. 2024). One code for three levels, which the training weighs."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.language.lifting import shares
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat_rivals.loop import Layers, Step, Trainee, adam, fewer_iterations, train

# Published: numbers of a code, layers of both decoders after them, learning rates, and iterations; weights of the entropy in the two
# halves of training, and of the variance in the second; half of the resolution, and the side of the square over which
# weights of levels are averaged there.
_DIMS, HIDDEN, SKIPS, SCALES = 16, (256,) * 8, ((0, 2), (2, 5)), (64, 128, 64, 32, 16, 3)
_CODE_RATE, _LAYER_RATE, _ITERATIONS = 1e-3, 1e-4, 30_000
ENTROPY, VARIANCE = (0.001, 0.002), 0.1
_STRIDE, _SMOOTHED = 2, 5


def train_granular(
    views: CodeViews, targets: CodeTargets, options: LanguageOptions, checkpoint: Checkpoint
) -> Coded:
    """Train codes, their decoder and the one that weighs the levels (UserError: there are not three, or training diverges)."""
    if len(targets.levels) != 3:
        raise UserError(
            f"language.method = granular needs three levels, not {', '.join(targets.levels)}; set another models.set"
        )
    codes = GranularCodes(views, targets.uncompressed(), options)
    curve = train(codes, len(views), options.iterations, options.seed, checkpoint)
    share = shares(views, lambda frame: targets.known(frame).all(dim=0, keepdim=True))
    stands_in = (
        "distillation alone: the segments are shared, not prompted by depth",
        *fewer_iterations(options.iterations, _ITERATIONS),
        f"the loss of {options.pixels:,} pixels of a view, drawn by region",
    )
    return Coded(codes.code.detach()[:, None], share, ["granular"], codes.decoder.trained(), curve, stands_in)


def weighted_target(weights: Tensor, features: Tensor, known: Tensor) -> Tensor:
    """(S, D) sum of (3, S, D) features by (S, 3) weights, which get a gradient; 0 unless all three are known."""
    return torch.einsum("sl,lsd->sd", weights, features) * known.all(dim=0)[:, None]


def entropy(weights: Tensor) -> Tensor:
    """() mean over all entries of ``-w log(w + 1e-6)``."""
    return -(weights * (weights + 1e-6).log()).mean()


@dataclass(frozen=True, eq=False)
class Sample:
    """S pixels drawn from R regions: (S,) int64 index of each, its region in [0, R), sorted; the (R,) int64 pixels that a
    region has in all (``size``), and that were drawn from it."""

    pixel: Tensor
    region: Tensor
    size: Tensor

    @property
    def drawn(self) -> Tensor:
        return self.region.bincount(minlength=len(self.size))


def sample_regions(region: Tensor, count: int, draw: torch.Generator) -> Sample:
    """Draw about ``count`` pixels, equally many of each region, at least 2, none twice; if that is too many, regions, too.

    The (Q,) int64 region of each pixel is any number, negative for none, on the CPU. The mean over regions of the mean over
    a region's drawn pixels has the expectation of that over all pixels, and so has a region's variance.
    """
    inside = (region >= 0).nonzero()[:, 0]
    names, place, size = region[inside].unique(return_inverse=True, return_counts=True)
    if (most := max(1, count // 2)) < len(names):
        kept = torch.zeros(len(names), dtype=torch.bool)
        kept[torch.randperm(len(names), generator=draw)[:most]] = True
        inside, size = inside[kept[place]], size[kept]
        place = (kept.cumsum(0) - 1)[place[kept[place]]]
    # In random order, then sorted by region: the first pixels of a region are a random part of it.
    order = torch.randperm(len(inside), generator=draw)
    order = order[place[order].argsort(stable=True)]
    first = size.cumsum(0) - size
    rank = torch.arange(len(order)) - first[place[order]]
    drawn = order[rank < max(2, count // max(1, len(size)))]
    return Sample(inside[drawn], place[drawn], size)


def mean_over_regions(values: Tensor, sample: Sample) -> Tensor:
    """() mean over regions of the mean of each region's (S,) values; 0 without regions."""
    regions = len(sample.size)
    sums = values.new_zeros(regions).index_add(0, sample.region.to(values.device), values)
    return (sums / sample.drawn.to(values).clamp(min=1)).sum() / max(1, regions)


def variance_within(values: Tensor, sample: Sample, pixels: int) -> Tensor:
    """() sum over regions of pixels * mean over channels of the variance within of (S, C) values, over all pixels."""
    drawn, region = sample.drawn.to(values)[:, None], sample.region.to(values.device)
    sums = values.new_zeros(len(sample.size), values.shape[1])
    means = sums.index_add(0, region, values) / drawn.clamp(min=1)
    squares = sums.index_add(0, region, (values - means[region]).square())
    variance = torch.where(drawn > 1, squares / (drawn - 1).clamp(min=1), 0.0).mean(dim=1)
    return (sample.size.to(values) * variance).sum() / pixels


class GranularCodes(Trainee):
    """Codes, (N, C), with two decoders: to features, and to the logits of the three levels' weights."""

    def __init__(self, views: CodeViews, targets: CodeTargets, options: LanguageOptions) -> None:
        """Start from zero codes and random decoders."""
        super().__init__(views, options)
        device = views.device
        dims = _DIMS if (given := targets.options["dims"]) == "auto" else given
        self.code = nn.Parameter(torch.zeros(views.gaussians.count, dims, device=device))
        self.decoder = Layers((dims, *HIDDEN, targets.channels), options.seed, device, skips=SKIPS)
        self.scales = Layers((dims, *SCALES), options.seed, device)
        self.optimizers = [
            adam([([self.code], _CODE_RATE)]),
            torch.optim.Adam([self.decoder.values, self.scales.values], lr=_LAYER_RATE),
        ]
        self._targets, self._half = targets, options.iterations / 2

    def loss(self, step: Step) -> Tensor:
        """Return the region-balanced L1, the entropy of the levels' weights, and in the second half the variance."""
        labels = self._targets.labels(self.frame(step.view))[:, ::_STRIDE, ::_STRIDE]
        rows = torch.arange(0, self.views.camera.height, _STRIDE)
        columns = torch.arange(0, self.views.camera.width, _STRIDE)
        pixels = torch.cartesian_prod(rows, columns).flip(1)
        with torch.no_grad():
            coarse = self.render(step.view, pixels, self.code)
            region = regions(self.weights(coarse).unflatten(0, labels.shape[1:]), labels)
        sample = sample_regions(region.flatten().cpu(), self.pixels, step.draw)
        pixels, labels = pixels[sample.pixel], labels.flatten(1)[:, sample.pixel]
        rendered = self.render(step.view, pixels, self.code)
        later = step.iteration > self._half
        loss = mean_over_regions(self._errors(step.view, rendered, labels, pixels), sample)
        drawn = torch.randint(len(coarse), (self.pixels,), generator=step.draw)
        loss = loss + ENTROPY[later] * entropy(self.weights(coarse[drawn]))
        return loss + VARIANCE * variance_within(rendered, sample, len(coarse)) if later else loss

    def weights(self, rendered: Tensor) -> Tensor:
        """(..., C) -> (..., 3) weights of the levels; the codes get no gradient."""
        return self.scales(rendered.detach()).softmax(dim=-1)

    def _errors(self, view: int, rendered: Tensor, labels: Tensor, pixels: Tensor) -> Tensor:
        """(S,) L1 of (S, 2) pixels."""
        features, known = self._targets.of_labels(self.frame(view), labels)
        target = weighted_target(self.weights(rendered), features, known)
        decoded = F.normalize(self.decoder(rendered), dim=-1)
        error = (decoded - target).abs().mean(dim=1) * known.all(dim=0)
        weight = self.views.weight(view)
        return error if weight is None else error * weight[pixels[:, 1], pixels[:, 0]]


def regions(weights: Tensor, labels: Tensor) -> Tensor:
    """(h, w) int64 of (3, h, w) instances, -1 for none, at the level of largest (h, w, 3) weight over 5 x 5 pixels."""
    smooth = F.avg_pool2d(weights.movedim(-1, 0)[None], _SMOOTHED, 1, _SMOOTHED // 2, count_include_pad=False)
    level = smooth[0].argmax(dim=0)
    return labels.gather(0, level[None])[0]


METHOD = Method(train_granular, masks="{} in place of SAM")
