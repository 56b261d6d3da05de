"""Train codes by gradient descent with fixed geometry: LangSplat's second stage, for all levels at once."""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.language.lifting import shares
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets, code_l1
from egosplat.language.views import CodeViews
from egosplat.rasterize.view import composite
from egosplat_rivals.loop import Step, Trainee, adam, fewer_iterations, train

# LangSplat's iterations.
_ITERATIONS = 30_000

# Norm of the random codes that normalized ones start from (docs/methods.md#langsplat). From LangSplat's 0, divided by
# 1e-9, the first gradient is a million times the next ones, and Adam hardly moves the codes until it has forgotten it,
# 20,000 iterations later.
_FIRST_NORM = 0.1


def train_codes(
    views: CodeViews, targets: CodeTargets, options: LanguageOptions, checkpoint: Checkpoint
) -> Coded:
    """Method ``train_codes``: codes by gradient descent, from the last checkpoint if there is one (UserError: it diverges)."""
    codes = PlainCodes(views, (len(targets.levels), targets.channels), options, targets.unit_norm)
    curve = train(codes, len(views), options.iterations, options.seed, checkpoint)
    stands_in = fewer_iterations(options.iterations, _ITERATIONS)
    if targets.unit_norm:
        stands_in += ("random codes at the start in place of 0",)
    # Stored as they are rendered, so that queries need not know whether codes are normalized.
    code, share = codes_to_render(codes.code.detach(), targets.unit_norm), shares(views, targets.known)
    return Coded(code, share, targets.levels, curve=curve, stands_in=stands_in)


class PlainCodes(Trainee):
    """Codes, (N, L, C), that render as they are."""

    advice = "lower language.lr"

    def __init__(
        self, views: CodeViews, shape: tuple[int, int], options: LanguageOptions, unit_norm: bool
    ) -> None:
        """Start from codes of ``shape`` (L, C): 0 as in LangSplat, or short random ones that are normalized."""
        super().__init__(views, options)
        first = torch.zeros(views.gaussians.count, *shape)
        if unit_norm:
            random = torch.Generator().manual_seed(options.seed)
            first = _FIRST_NORM * codes_to_render(first.normal_(generator=random), True)
        self.code = nn.Parameter(first.to(views.device))
        self.optimizers = [adam([([self.code], options.lr)])]
        self._unit_norm = unit_norm

    def loss(self, step: Step) -> Tensor:
        """Return the L1 loss of the whole image."""
        targets = self.views.targets(self.frame(step.view))
        values = codes_to_render(self.code, self._unit_norm).flatten(1)
        image, _ = composite(self.views.view(step.view), values)
        codes = image.permute(2, 0, 1).unflatten(0, targets.codes.shape[:2])
        return code_l1(codes, targets, self.views.weight(step.view))


def codes_to_render(code: Tensor, unit_norm: bool) -> Tensor:
    """(N, L, C) codes as rendered: normalized if they have ``unit_norm``; zero codes stay 0."""
    return F.normalize(code, dim=-1) if unit_norm else code


METHOD = Method(train_codes, masks="{} in place of SAM")
