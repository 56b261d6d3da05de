"""Splat Feature Solver (Xiong et al., ICLR 2026): lift with sharpened opacities, and average the masks that agree with a cluster."""

import importlib
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from egosplat.errors import from_extra
from egosplat.features.compression import fit_linear
from egosplat.gaussians.model import Gaussians
from egosplat.language.lifting import LEAST_WEIGHT, labeled_share
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat.progress import track
from egosplat.rasterize.view import composite_sparse, sum_over_pixels
from egosplat_rivals.langsplat import codes_to_render

# Published: factor of the logits of opacities; least IoU of a mask with its cluster.
SHARPENING, AGREEMENT = 1.2, 0.8


def lift_clusters(views: CodeViews, targets: CodeTargets, options: LanguageOptions, *_: object) -> Coded:
    """Method ``lift_clusters``: lifted codes; those of a cluster become the mean code of the masks that agree with it.

    Each level is clustered by itself. Gaussians in no cluster, or in one that no mask agrees with, keep their lifted code. UserError if
    scikit-learn is not installed."""
    with from_extra("sklearn"):
        importlib.import_module("sklearn.cluster")
    sharp = replace(views, gaussians=sharpen(views.gaussians))
    lifted, lifted_share = lift(sharp)
    levels = zip(lifted.unbind(1), lifted_share.unbind(1), strict=True)
    labels = torch.stack([clusters_of(code, share, options.seed) for code, share in levels], dim=1)
    means, known = mask_means(sharp, targets, labels)
    # Gaussians in no cluster read the last row, which is never known.
    level = torch.arange(len(targets.levels), device=views.device)
    code = torch.where(known[level, labels][..., None], means[level, labels], lifted)
    code = codes_to_render(code, targets.unit_norm)
    stands_in = ["opacities sharpened where codes are lifted, not where they are rendered"]
    if views.gaussians.count > SAMPLE:
        stands_in.append(f"clusters of {SAMPLE:,} Gaussians, which the others join by their nearest")
    return Coded(code, lifted_share, targets.levels, stands_in=tuple(stands_in))


def sharpen(gaussians: Gaussians) -> Gaussians:
    """The Gaussians with opacities nearer to 0 and 1; 0, 1/2 and 1 stay."""
    return replace(gaussians, logit_opacities=SHARPENING * gaussians.logit_opacities)


def lift(views: CodeViews) -> tuple[Tensor, Tensor]:
    """Average codes over all views, at least one: ``f_g = sum w_gp F(p) / sum w_gp`` over the pixels p with a code (docs/method.md#mean-codes).
    (N, L, C) codes of N Gaussians at L levels, and (N, L) shares, as in language.zarr. w is alpha times transmittance times 1 - M."""
    assert views.targets is not None
    sums = torch.zeros((), device=views.device)
    for index in track(range(len(views)), "lifting", unit="view"):
        targets, weight = views.targets(int(views.frame[index])), views.weight(index)
        shown = (
            torch.ones_like(targets.codes[:, :1])
            if weight is None
            else weight.expand_as(targets.codes[:, :1])
        )
        counted = targets.known[:, None] * shown
        pixels = torch.cat([targets.codes * counted, counted, shown], dim=1)
        part = sum_over_pixels(views.view(index), pixels.flatten(0, 1).permute(1, 2, 0))
        sums = sums + part.unflatten(1, pixels.shape[:2])
    code, known, seen = sums.split([sums.shape[2] - 2, 1, 1], dim=2)
    mean = torch.where(known > LEAST_WEIGHT, code / known.clamp(min=LEAST_WEIGHT), 0.0)
    return mean, labeled_share(known[..., 0], seen[..., 0])


def mask_means(views: CodeViews, targets: CodeTargets, labels: Tensor) -> tuple[Tensor, Tensor]:
    """Average the codes of the masks that agree with each of K clusters, each mask of a frame counting once.

    ``labels`` are the (N, L) int64 cluster of each Gaussian at each level, -1 for none. Returns (L, K + 1, C) means, and (L, K + 1)
    whether any mask agrees; the last row is 0."""
    shape = labels.shape[1], int(labels.max()) + 2
    sums = torch.zeros(*shape, targets.channels, device=views.device)
    counts = torch.zeros(shape, device=views.device)
    count = len(labels)
    data, begin = np.ones(count, np.float32), np.arange(count + 1)
    # (N, K + 1), 1 in the column of each Gaussian's cluster.
    members = [sparse.csr_array((data, row.cpu().numpy() + 1, begin), (count, shape[1])) for row in labels.T]
    for index in track(range(len(views)), "comparing masks with clusters", unit="view"):
        frame, weight, view = int(views.frame[index]), views.weight(index), views.view(index)
        for level, masks in enumerate(targets.labels(frame)):
            shown = composite_sparse(view, members[level]).argmax(dim=0)
            instances, cluster = agreeing(masks, shown - 1, weight)
            codes, usable = targets.of_labels(frame, instances)
            sums[level].index_add_(0, cluster, codes * usable[:, None])
            counts[level].index_add_(0, cluster, usable.float())
    return sums / counts.clamp(min=1)[..., None], counts > 0


def agreeing(masks: Tensor, clusters: Tensor, weight: Tensor | None) -> tuple[Tensor, Tensor]:
    """(M,) int64 masks of a picture that overlap with their most frequent cluster by an IoU above ``AGREEMENT``, and those.

    ``masks`` and ``clusters`` are (H, W) int64, -1 for none; ``weight`` that of each pixel, None for ones."""
    names, mask = masks.unique(return_inverse=True)
    count = int(clusters.max()) + 2
    pairs = (mask * count + clusters + 1).flatten()
    area = None if weight is None else weight.flatten()
    table = torch.bincount(pairs, area, minlength=len(names) * count).view(len(names), count).double()
    shared, cluster = table.max(dim=1)
    union = table.sum(dim=1) + table.sum(dim=0)[cluster] - shared
    agrees = (names >= 0) & (cluster > 0) & (shared > AGREEMENT * union)
    return names[agrees], cluster[agrees] - 1


# Published: principal components; Gaussians near a dense one; Gaussians of the smallest cluster.
COMPONENTS, NEIGHBORS, LEAST = 50, 10, 500

# Gaussians that are clustered: the time grows with the square of their number. Decimals kept of coordinates whose largest
# is 1: what is left out is rounding of sums, and no cluster.
SAMPLE, _DECIMALS = 20_000, 5


def clusters_of(code: Tensor, share: Tensor, seed: int) -> Tensor:
    """(N,) int64 clusters of (N, C) codes, -1 for none and for codes whose (N,) share is 0.

    A random sample is clustered, and the others take the cluster of the nearest one."""
    # Imported here: it takes a second, which other methods need not wait.
    from sklearn.cluster import HDBSCAN
    from sklearn.metrics import pairwise_distances_argmin

    labels = torch.full((len(code),), -1)
    rows = share.cpu().nonzero()[:, 0]
    if len(rows) < LEAST:
        return labels.to(code.device)
    values = code.cpu()[rows]
    draw = torch.Generator().manual_seed(seed)
    chosen = torch.randperm(len(rows), generator=draw)[:SAMPLE]
    parts = principal_components(values, chosen)
    least = max(2, round(LEAST * len(chosen) / len(rows)))
    # Other algorithms than a k-d tree may hold all distances.
    model = HDBSCAN(min_cluster_size=least, min_samples=NEIGHBORS, algorithm="kd_tree", copy=True)
    found = model.fit_predict(parts[chosen])
    labels[rows] = torch.from_numpy(found[pairwise_distances_argmin(parts, parts[chosen])]).long()
    return labels.to(code.device)


def principal_components(values: Tensor, sample: Tensor) -> NDArray[np.float32]:
    """(N, min(C, COMPONENTS)) coordinates of (N, C) values along the axes of most variance in a sample, (S,) int64 rows.

    They are scaled so that the largest is 1, and rounded."""
    parts = fit_linear(values[sample].numpy(), COMPONENTS).encode(values.numpy())
    return (parts / (np.abs(parts).max() or 1.0)).round(_DECIMALS)


METHOD = Method(lift_clusters, masks="{} in place of SAM")
