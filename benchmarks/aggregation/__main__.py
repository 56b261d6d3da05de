"""What aggregation over views is worth, and how many dimensions codes need, on held-out worlds.

Tracks of things are made wrong in part; then each thing is to be named by the text that is nearest to its feature.

    python -m training.render_worlds data/held_out --worlds 20 --held-out
    python -m benchmarks.aggregation data/held_out

writes aggregation.md and aggregation.png beside this file. With --clip-model and --clip-checkpoint for another OpenCLIP
than the small one.
"""

from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import torch
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
from benchmarks.aggregation.corruption import KINDS, corrupted
from benchmarks.aggregation.tracks import Features, Tracks, find_tracks
from egosplat.codes.decoder import decode
from egosplat.codes.vectors import unit
from egosplat.errors import UserError
from egosplat.features.aggregation import NORMS, aggregate
from egosplat.features.compression import fit
from egosplat.features.quality import reconstruction, spread
from egosplat.files import atomic_file
from egosplat.models.open_clip_loader import OpenClip, load_open_clip
from egosplat.progress import track
from egosplat.report.figure import label_log_axis, plt
from egosplat.synthetic.objects.catalogue import CATEGORY_UIDS
from training.small_models.worlds import read_world

SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
METHODS = {"view": "each view alone", "none": "mean of all views"} | {
    norm: f"MAD, {norm}, k = 3" for norm in NORMS if norm != "none"
}
DIMS = {"linear": (1, 2, 3, 4, 6, 8, 12, 16, 24, 32), "autoencoder": (3, 4, 8, 16)}
"""By kind of compression; an autoencoder takes a hundred times as long to fit."""
TOPS = (1, 5)
"""The true name must be among so many of the nearest."""

TRIALS = 5
K = 3.0


class Naming:
    """Things that are named by the nearest of all names."""

    def __init__(self, tracks: Tracks, clip: OpenClip) -> None:
        self.tracks = tracks
        names = sorted(CATEGORY_UIDS)
        with clip.compute.inference():
            self.texts = unit(clip.model.encode_text(clip.tokenizer(names)).float().numpy())
        self.truth = np.searchsorted(names, tracks.name)

    def hits(self, features: NDArray[np.floating], truth: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(tops, R) whether the true text is among the nearest to each feature."""
        nearness = features @ self.texts.T
        nearer = (nearness > np.take_along_axis(nearness, truth[:, None], axis=1)).sum(axis=1)
        return np.stack([nearer < top for top in TOPS])

    def accuracy(self, features: Features, method: str) -> NDArray[np.float64]:
        """(tops,) share of things, each counted once, that are named right from (R, D) features of their views."""
        thing, count = self.tracks.thing, len(self.truth)
        if method == "view":
            hits = self.hits(features, self.truth[thing])
            return np.stack([np.bincount(thing, hit) / np.bincount(thing) for hit in hits]).mean(axis=1)
        return self.hits(aggregate(features, thing, count, method, K).feature, self.truth).mean(axis=1)


def accuracies(naming: Naming) -> dict[str, NDArray[np.float64]]:
    """For each kind of corruption (methods, shares, tops) accuracies, means over the trials."""
    found = {kind: np.zeros((len(METHODS), len(SHARES), len(TOPS))) for kind in KINDS}
    for kind in KINDS:
        for column, share in enumerate(track(SHARES, f"corrupting: {kind}", unit="share")):
            for trial in range(TRIALS):
                features = corrupted(naming.tracks, kind, share, np.random.default_rng([trial, column]))
                found[kind][:, column] += [naming.accuracy(features, method) / TRIALS for method in METHODS]
    return found


def compressed(naming: Naming, epochs: int) -> Iterator[tuple[str, int, float, float, float]]:
    """Kind, dimensions, mean reconstruction cosine, mean cosine between decoded things, accuracy after decoding.

    Each world has a compression of its own, fitted to the averages of its views' and things' features.
    """
    tracks = naming.tracks
    consistent = unit(aggregate(tracks.feature, tracks.thing, len(tracks.name), "element", K).feature).astype(
        np.float32
    )
    supervision = unit(tracks.feature + consistent[tracks.thing]).astype(np.float32)
    for kind, dims in [
        ("none", supervision.shape[1]),
        *((kind, dims) for kind, several in DIMS.items() for dims in several),
    ]:
        rows = []
        for world in np.unique(tracks.world):
            mine = tracks.world == world
            features = supervision[mine[tracks.thing]]
            fitted = fit(features, kind, dims, epochs, 0)
            decoded = decode(torch.from_numpy(fitted.encode(consistent[mine])), fitted.decoder).numpy()
            cosine = reconstruction(features, fitted.encode(features), fitted.decoder).mean()
            rows.append(
                (cosine, spread(decoded), naming.hits(decoded, naming.truth[mine])[0].mean(), mine.sum())
            )
        cosine, apart, right, weight = np.array(rows, float).T
        yield kind, dims, cosine.mean(), apart.mean(), float(np.average(right, weights=weight))


def markdown(naming: Naming, found: dict[str, NDArray], codes: list[tuple], model: str) -> str:
    """The page."""
    tracks = naming.tracks
    views = np.bincount(tracks.thing)
    said = (
        f"{len(tracks.name)} things of {len(np.unique(tracks.world))} held-out worlds with {views.min()} to "
        f"{views.max()} views (mean {views.mean():.1f}), OpenCLIP {model}; accuracy is the share of things named "
        f"right among {len(naming.texts)} names, with the true one nearest / among the {TOPS[1]} nearest, mean of "
        f"{TRIALS} trials."
    )
    lines = ["# Aggregation and compression of features", "", said]
    for kind, about in KINDS.items():
        lines += ["", f"## Wrong views: {about}", "", f"| share wrong | {' | '.join(METHODS.values())} |"]
        lines += ["| ---: " * (1 + len(METHODS)) + "|"]
        for column, share in enumerate(SHARES):
            cells = " | ".join(
                " / ".join(f"{value:.3f}" for value in each) for each in found[kind][:, column]
            )
            lines.append(f"| {share:.0%} | {cells} |")
    lines += ["", "## Compression of each world's features", ""]
    lines += [
        "| kind | dimensions | reconstruction cosine | cosine between things | nearest is the true one |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    lines += [f"| {kind} | {dims} | {a:.3f} | {b:.3f} | {c:.3f} |" for kind, dims, a, b, c in codes]
    return "\n".join([*lines, "", "Made by `python -m benchmarks.aggregation`.", ""])


def draw(found: dict[str, NDArray], codes: list[tuple], path: Path) -> None:
    """Accuracy against the share of wrong views, and against the dimensions of codes."""
    figure, cells = plt.subplots(1, len(KINDS) + 1, figsize=(16, 4), layout="constrained")
    for cell, (kind, about) in zip(cells, KINDS.items(), strict=False):
        for method, values in zip(METHODS.values(), found[kind][..., 0], strict=True):
            cell.plot(SHARES, values, marker="o", markersize=3, label=method)
        cell.set(title=about, xlabel="share of wrong views", ylim=(0, 1))
        cell.grid(alpha=0.3)
    cells[0].set(ylabel="things named right")
    cells[0].legend(fontsize=8)
    whole = codes[0][4]
    for kind in DIMS:
        rows = [row for row in codes if row[0] == kind]
        cells[-1].plot(
            [row[1] for row in rows], [row[4] for row in rows], marker="o", markersize=3, label=kind
        )
    cells[-1].axhline(whole, color="0.5", linestyle="--", label="not compressed")
    cells[-1].set(title="after compression", xlabel="dimensions of a code", xscale="log", ylim=(0, 1))
    label_log_axis(cells[-1].xaxis)
    cells[-1].legend(fontsize=8)
    cells[-1].grid(alpha=0.3)
    with atomic_file(path) as scratch:
        figure.savefig(scratch, dpi=90, format="png")
    plt.close(figure)


@click.command(help=__doc__)
@click.argument("worlds", type=click.Path(exists=True, path_type=Path))
@click.option("--clip-model", default="small", show_default=True)
@click.option("--clip-checkpoint", default="small", show_default=True)
@click.option("--epochs", default=100, show_default=True, help="Of the autoencoders.")
@click.option("--output", default=HERE / "README.md", type=click.Path(path_type=Path), show_default=True)
def main(worlds: Path, clip_model: str, clip_checkpoint: str, epochs: int, output: Path) -> None:
    folders = sorted(folder for folder in worlds.iterdir() if folder.name.isdigit())
    if not folders:
        raise UserError(
            f"{worlds}: holds no worlds; run python -m training.render_worlds {worlds} --worlds 20 --held-out"
        )
    clip = load_open_clip(clip_model, clip_checkpoint, "cpu", "float32")
    naming = Naming(find_tracks([read_world(folder) for folder in folders], set(CATEGORY_UIDS), clip), clip)
    found, codes = accuracies(naming), list(compressed(naming, epochs))
    with atomic_file(output) as scratch:
        scratch.write_text(markdown(naming, found, codes, clip_model))
    draw(found, codes, output.with_name("aggregation.png"))
    click.echo(output.read_text())


if __name__ == "__main__":
    main()
