"""Accuracy of features aggregated over views, and of their compression, on held-out worlds.

    python -m training.render_worlds data/held_out --worlds 20 --held-out
    python -m benchmarks.aggregation data/held_out > benchmarks/aggregation/README.md

Replaces a share of each object's views by wrong ones, then names each object by the text nearest to its feature.
"""

from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.aggregation.tracks import KINDS, Features, Tracks, corrupted, find_tracks
from benchmarks.common import command, markdown
from benchmarks.small_sam2.worlds import world_folders
from egosplat.features.aggregation import NORMS, aggregate
from egosplat.features.compression import fit
from egosplat.features.supervision import reconstruction, spread
from egosplat.language.decoder import decode
from egosplat.language.vectors import unit
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.progress import track
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS
from training.small_models.worlds import read_world

SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
METHODS = {"view": "each view alone", "none": "mean of all views"} | {
    norm: f"MAD, {norm}, k = 3" for norm in NORMS if norm != "none"
}
# By kind of compression; an autoencoder takes a hundred times as long to fit.
DIMS = {"linear": (1, 2, 3, 4, 6, 8, 12, 16, 24, 32), "autoencoder": (3, 4, 8, 16)}
# The true name must be among this many nearest ones.
TOPS = (1, 5)

K = 3.0


class Naming:
    """Objects that are named by the nearest of all names."""

    def __init__(self, tracks: Tracks, clip: OpenClip) -> None:
        self.tracks = tracks
        names = sorted(CATEGORY_UIDS)
        with clip.compute.inference():
            self.texts = unit(clip.model.encode_text(clip.tokenizer(names)).float().numpy())
        self.truth = np.searchsorted(names, tracks.name)

    def hits(self, features: NDArray[np.floating], truth: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(tops, R) whether the true text is among the nearest to each feature."""
        similarity = features @ self.texts.T
        nearer = (similarity > np.take_along_axis(similarity, truth[:, None], axis=1)).sum(axis=1)
        return np.stack([nearer < top for top in TOPS])

    def accuracy(self, features: Features, method: str) -> NDArray[np.float64]:
        """(tops,) share of objects named right from (R, D) features of their views; each object counts once."""
        thing, count = self.tracks.thing, len(self.truth)
        if method == "view":
            hits = self.hits(features, self.truth[thing])
            return np.stack([np.bincount(thing, hit) / np.bincount(thing) for hit in hits]).mean(axis=1)
        return self.hits(aggregate(features, thing, count, method, K).feature, self.truth).mean(axis=1)


def accuracies(naming: Naming, kind: str, trials: int) -> NDArray[np.float64]:
    """(methods, shares, tops) accuracies with one kind of wrong views, means over the trials."""
    found = np.zeros((len(METHODS), len(SHARES), len(TOPS)))
    for column, share in enumerate(track(SHARES, f"corrupting: {kind}", unit="share")):
        for trial in range(trials):
            features = corrupted(naming.tracks, kind, share, np.random.default_rng([trial, column]))
            found[:, column] += [naming.accuracy(features, method) / trials for method in METHODS]
    return found


def compressed(naming: Naming, epochs: int) -> Iterator[list[object]]:
    """Rows: kind, dimensions, mean reconstruction cosine, mean cosine between objects, accuracy after decoding.

    Each world has its own compression, fitted to the averages of its views' and objects' features.
    """
    tracks = naming.tracks
    features = aggregate(tracks.feature, tracks.thing, len(tracks.name), "element", K).feature
    consistent = unit(features).astype(np.float32)
    supervision = unit(tracks.feature + consistent[tracks.thing]).astype(np.float32)
    settings = [(kind, dims) for kind, several in DIMS.items() for dims in several]
    for kind, dims in [("none", supervision.shape[1]), *settings]:
        rows = []
        for world in np.unique(tracks.world):
            mine = tracks.world == world
            features = supervision[mine[tracks.thing]]
            fitted = fit(features, kind, dims, epochs, 0)
            decoded = decode(torch.from_numpy(fitted.encode(consistent[mine])), fitted.decoder).numpy()
            cosine = reconstruction(features, fitted.encode(features), fitted.decoder).mean()
            right = naming.hits(decoded, naming.truth[mine])[0].mean()
            rows.append((cosine, spread(decoded), right, mine.sum()))
        cosine, apart, right, weight = np.array(rows, float).T
        means = (cosine.mean(), apart.mean(), float(np.average(right, weights=weight)))
        yield [kind, dims, *(f"{mean:.3f}" for mean in means)]


def introduction(naming: Naming, model: str, trials: int) -> str:
    """Title and first lines of the page."""
    tracks = naming.tracks
    views = np.bincount(tracks.thing)
    return (
        f"# Aggregation and compression of features\n\n`python -m benchmarks.aggregation`: {len(tracks.name)} objects of "
        f"{len(np.unique(tracks.world))} held-out worlds with {views.min()} to {views.max()} views (mean {views.mean():.1f}), "
        f"OpenCLIP {model}. Accuracy is the share of objects named right among {len(naming.texts)} names, with the true one "
        f"nearest / among the {TOPS[1]} nearest, mean of {trials} trials."
    )


@command(__doc__)
@click.argument("worlds", type=click.Path(exists=True, path_type=Path))
@click.option("--clip-model", default="small", show_default=True)
@click.option("--clip-checkpoint", default="small", show_default=True)
@click.option("--epochs", default=100, show_default=True, help="Of the autoencoders.")
@click.option("--trials", default=5, show_default=True, help="Draws of wrong views.")
def main(worlds: Path, clip_model: str, clip_checkpoint: str, epochs: int, trials: int) -> None:
    """Print the tables."""
    clip = load_open_clip(clip_model, clip_checkpoint, "cpu", "float32")
    films = [read_world(folder) for folder in world_folders(worlds)]
    naming = Naming(find_tracks(films, set(CATEGORY_UIDS), clip), clip)
    click.echo(introduction(naming, clip_model, trials))
    for kind, about in KINDS.items():
        found = accuracies(naming, kind, trials)
        rows = [
            [f"{share:.0%}", *(" / ".join(f"{value:.3f}" for value in each) for each in found[:, column])]
            for column, share in enumerate(SHARES)
        ]
        table = markdown(["share wrong", *METHODS.values()], rows, words=0)
        click.echo(f"\n## Wrong views: {about}\n\n{table}")
    columns = ("kind", "dimensions", "reconstruction cosine", "cosine between objects", "nearest is right")
    click.echo(
        f"\n## Compression of each world's features\n\n{markdown(columns, compressed(naming, epochs))}"
    )


if __name__ == "__main__":
    main()
