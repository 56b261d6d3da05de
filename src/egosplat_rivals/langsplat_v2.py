"""Method ``train_mixtures``: LangSplatV2 (Li et al., NeurIPS 2025). A code is a mixture of four words of a codebook."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from torch import Tensor, nn
from torch.nn import functional as F

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.language.decoder import Decoder
from egosplat.language.lifting import shares
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat_rivals.loop import Step, Trainee, adam, fewer_iterations, train

# Published: words of the codebook, words in a code, and iterations of each level's model. Rounds of k-means; on instance
# features, 20 leave nothing to gain.
WORDS, CHOSEN, _ITERATIONS, _ROUNDS = 64, 4, 10_000, 20


def train_mixtures(
    views: CodeViews, targets: CodeTargets, options: LanguageOptions, checkpoint: Checkpoint
) -> Coded:
    """Train coefficients and the codebook, a level an iteration in turn (UserError: no view has a feature, or it diverges)."""
    features = targets.uncompressed()
    words = torch.from_numpy(codebook(features.rows, options.seed)).to(views.device)
    codes = SparseCodes(views, features, words, options)
    curve = train(codes, len(views), options.iterations, options.seed, checkpoint)
    share = shares(views, targets.known)
    stands_in = (
        *fewer_iterations(options.iterations // len(targets.levels), _ITERATIONS, " a level"),
        f"the loss of {options.pixels:,} pixels of a view",
        "one codebook for all levels",
    )
    return Coded(codes.code(), share, targets.levels, codes.decoder(), curve, stands_in)


def codebook(rows: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
    """Cluster (R, D) features into at most ``WORDS`` centers, (K, D) float32; raises UserError without features."""
    different = np.unique(rows, axis=0)
    if not len(different):
        raise UserError("language.method = sparse: no view of an instance has a feature; use lifted")
    if len(different) <= WORDS:
        return different
    centers, _ = kmeans2(rows.astype(np.float64), WORDS, _ROUNDS, minit="++", seed=seed)
    return centers.astype(np.float32)


def coefficients(logits: Tensor) -> Tensor:
    """(..., K) logits -> the softmax of the four largest, 0 elsewhere; only those four get a gradient."""
    # Softmax, the four largest, divided by their sum: the softmax of the four alone.
    largest = logits.topk(min(CHOSEN, logits.shape[-1]), dim=-1)
    return torch.zeros_like(logits).scatter(-1, largest.indices, largest.values.softmax(dim=-1))


class SparseCodes(Trainee):
    """Logits of each level, L of (N, K), from zeros, and the (K, D) words of the codebook."""

    advice = "lower language.lr"

    def __init__(
        self, views: CodeViews, targets: CodeTargets, words: Tensor, options: LanguageOptions
    ) -> None:
        """Start from a codebook."""
        super().__init__(views, options)
        self.words = nn.Parameter(words)
        zeros = words.new_zeros(views.gaussians.count, len(words))
        self.logits = nn.ParameterList([nn.Parameter(zeros.clone()) for _ in targets.levels])
        self.optimizers = [
            adam([(self.logits, options.lr)]),
            torch.optim.Adam([self.words], lr=options.lr),
        ]
        self._targets = targets

    def loss(self, step: Step) -> Tensor:
        """Return the mean of 1 - cosine; pixels without a feature count 0."""
        level, frame = step.iteration % len(self.logits), self.frame(step.view)
        pixels, weight = self.draw_pixels(step)
        rendered = self.render(step.view, pixels, coefficients(self.logits[level]))
        labels = self._targets.labels(frame)[level][pixels[:, 1], pixels[:, 0]]
        wanted, known = self._targets.of_labels(frame, labels)
        cosine = F.cosine_similarity(rendered @ self.words, wanted, dim=-1)
        return ((1 - cosine) * known * weight).sum() / max(1, len(pixels))

    @torch.no_grad()
    def code(self) -> Tensor:
        """(N, L, K) coefficients."""
        return torch.stack([coefficients(one) for one in self.logits], dim=1)

    def decoder(self) -> Decoder:
        """The codebook as a layer without biases."""
        words = self.words.detach().cpu()
        values = torch.cat([words.T.reshape(-1), torch.zeros(words.shape[1])])
        return Decoder(tuple(words.shape), values.numpy())


METHOD = Method(train_mixtures, masks="{} in place of SAM")
