"""Clusters of codes by density: HDBSCAN along their principal components."""

import importlib.util

import torch
from torch import Tensor

from egosplat.errors import UserError

# Published: principal components; Gaussians near a dense one; Gaussians of the smallest cluster.
COMPONENTS, NEIGHBORS, LEAST = 50, 10, 500

# Decimals kept of coordinates whose largest is 1: what is left out is rounding of sums, and no cluster.
_DECIMALS = 5

# Gaussians that are clustered: the time grows with the square of their number.
SAMPLE = 20_000


def check_installed() -> None:
    """Raise UserError if the library that finds clusters is absent."""
    if importlib.util.find_spec("sklearn") is None:
        raise UserError(
            'scikit-learn is not installed; it comes with the extra "clusters": pip install "egosplat[clusters]"'
        )


def clusters_of(code: Tensor, share: Tensor, seed: int) -> Tensor:
    """Cluster the codes of Gaussians; a random sample is clustered, and the others take the cluster of the nearest one.

    Args:
        code: (N, C) floats.
        share: (N,) 0 for Gaussians without a code.
        seed: of the sample.

    Returns:
        (N,) int64 cluster, from 0, or -1 for none.
    """
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
    parts = principal_components(values, chosen).numpy()
    least = max(2, round(LEAST * len(chosen) / len(rows)))
    model = HDBSCAN(
        min_cluster_size=least,
        min_samples=NEIGHBORS,
        algorithm="kd_tree",  # others may hold all distances
        copy=True,
    )
    found = model.fit_predict(parts[chosen])
    labels[rows] = torch.from_numpy(found[pairwise_distances_argmin(parts, parts[chosen])]).long()
    return labels.to(code.device)


def principal_components(values: Tensor, sample: Tensor) -> Tensor:
    """Coordinates of values along the axes of most variance in a sample of them, scaled so that the largest is 1.

    Args:
        values: (N, C).
        sample: (S,) int64 rows.

    Returns:
        (N, min(C, COMPONENTS)), rounded.
    """
    drawn = values[sample].double()
    mean = drawn.mean(dim=0)
    # In float64 also where the variance is far below the mean. Eigenvalues ascend.
    axes = torch.linalg.eigh((drawn - mean).T @ (drawn - mean)).eigenvectors[:, -COMPONENTS:]
    parts = (values - mean.float()) @ axes.float()
    largest = parts.abs().max()
    return (parts / torch.where(largest > 0, largest, 1.0)).round(decimals=_DECIMALS)
