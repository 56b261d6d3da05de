"""Accuracy of features aggregated over the views of tracks that slip onto one other thing, and how far the paper's tracks slip.

    snakemake --cores 2 --configfile benchmarks/aggregation/config.yaml -- results/adt/{busy,scene}{1,2}/instances.zarr
    python -m benchmarks.aggregation results/adt/{busy,scene}{1,2} --output benchmarks/aggregation

Names each thing by the text nearest to the mean of its views. A crop follows from a frame and a mask, so true views with exchanged
things are what ``instances.source: tracks`` gives where a tracker slips.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import click
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.aggregation.tracks import Features, Tracks, read_tracks, shares_of_others, slipped_tracks
from benchmarks.common import command, markdown, scene_folders
from egosplat.drawing import plt, save_figure
from egosplat.features.aggregation import aggregate
from egosplat.language.vectors import unit
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.progress import track
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS

SHARES = (0.0, 0.1, 0.2, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6)
ROWS, PICTURE = "rows.csv.xz", "slipped.png"
# Draws of wrong views, and of things for an interval.
TRIALS, DRAWS = 5, 1000


def geometric_median(views: Features) -> NDArray[np.float64]:
    """(D,) the point of least summed distance to (V, D) views."""
    center = views.mean(axis=0, dtype=np.float64)
    for _ in range(50):
        weight = 1 / np.maximum(np.linalg.norm(views - center, axis=1), 1e-6)
        center = weight @ views / weight.sum()
    return center


def by_mad(k: float, norm: str = "element") -> Callable[[Features], NDArray[np.float64]]:
    """The mean of the views that deviate from their median by at most k MAD."""
    return lambda views: aggregate(views, np.zeros(len(views), np.int64), 1, norm, k).feature[0]


METHODS: dict[str, Callable[[Features], NDArray[np.float64]]] = {
    "mean of all views": by_mad(3.0, "none"),
    "MAD, k = 3": by_mad(3.0),
    "MAD, k = 1": by_mad(1.0),
    "geometric median": geometric_median,
}
EACH = "each view alone"


def named(tracks: Tracks) -> pd.DataFrame:
    """Rows: share of slipped views, method, thing, and the share of its trials (or of its views) that are named right."""
    clip = load_open_clip("small", "small", "cpu", "float32")
    names = sorted(CATEGORY_UIDS)
    with clip.compute.inference():
        texts = unit(clip.model.encode_text(clip.tokenizer(names)).float().numpy())
    truth = np.searchsorted(names, tracks.name)
    first = np.searchsorted(tracks.thing, np.arange(1, len(truth)))
    found = []
    for share in track(SHARES, "slipping", unit="share"):
        hits = np.zeros((len(METHODS) + 1, len(truth)))
        for trial in range(TRIALS):
            features = slipped_tracks(tracks, share, np.random.default_rng(trial))
            for thing, views in enumerate(np.split(features, first)):
                nearest = [texts @ method(views) for method in METHODS.values()]
                hits[:-1, thing] += [scores.argmax() == truth[thing] for scores in nearest]
                hits[-1, thing] += ((views @ texts.T).argmax(axis=1) == truth[thing]).mean()
        for method, right in zip((*METHODS, EACH), hits / TRIALS, strict=True):
            found += [(share, method, thing, round(value, 3)) for thing, value in enumerate(right)]
    return pd.DataFrame(found, columns=["share", "method", "thing", "right"])


def gains(rows: pd.DataFrame) -> str:
    """The table: things named right by the mean [%], and what each other method gains [points], with 95 % intervals over things."""
    things = rows.pivot_table(index=["share", "thing"], columns="method", values="right")
    drawn = np.random.default_rng(0).integers(0, rows["thing"].nunique(), (DRAWS, rows["thing"].nunique()))
    lines = []
    for share, right in things.groupby(level="share"):
        mean, *others = METHODS
        line = [f"{share:.0%}", f"{100 * right[mean].mean():.1f}"]
        for method in (*others, EACH):
            gained = 100 * (right[method] - right[mean]).to_numpy()
            low, high = np.percentile(gained[drawn].mean(axis=1), [2.5, 97.5])
            line.append(f"{gained.mean():+.1f} ({low:+.1f} to {high:+.1f})")
        lines.append(line)
    return markdown(["slipped views", *METHODS, EACH], lines)


def draw(rows: pd.DataFrame, output: Path) -> None:
    """Draw how many things each method names right, by the share of slipped views."""
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    means = rows.groupby(["method", "share"])["right"].mean()
    for method in (*METHODS, EACH):
        line = 100 * means[method]
        axes.plot(100 * line.index, line, "o-", ms=3, label=method)
    axes.set(
        xlabel="views of a thing that show one other thing [%]",
        ylabel="things named right [%]",
        ylim=(0, 100),
    )
    axes.legend(fontsize=8)
    save_figure(figure, output)


def slips(folders: Sequence[Path]) -> str:
    """Lines on how far the tracks of finished scenes slip."""
    lines = []
    for folder in folders:
        if (folder / "instances.zarr").exists():
            views, others, other = shares_of_others(folder, folder / "instances.zarr")
            lines.append(
                [
                    folder.name,
                    len(views),
                    f"{views.mean():.0f}",
                    f"{np.average(others, weights=views):.1%}",
                    f"{(other >= 0.3).mean():.1%}",
                ]
            )
    return markdown(
        ["scene", "instances", "views each", "slipped views", "instances with 30 % of one other thing"], lines
    )


@command(__doc__)
@scene_folders
@click.option(
    "--output", type=click.Path(path_type=Path), required=True, help="Folder of the rows and the picture."
)
def main(folders: tuple[Path, ...], output: Path) -> None:
    """Write the rows and the picture, and print the tables."""
    tracks = read_tracks(folders, set(CATEGORY_UIDS))
    rows = named(tracks)
    rows.to_csv(output / ROWS, index=False)
    draw(rows, output / PICTURE)
    click.echo(
        f"{len(tracks.name)} things, {len(tracks.thing) / len(tracks.name):.0f} views each, {TRIALS} trials.\n"
    )
    click.echo(f"{gains(rows)}\n\n{slips(folders)}")


if __name__ == "__main__":
    main()
