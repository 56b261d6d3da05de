"""Draw what each preset gains over ``draft`` in the apartments of the ledger: ``python -m benchmarks.tradeoff docs/tradeoff.png``."""

from collections.abc import Iterator
from pathlib import Path

import click
import pandas as pd
from matplotlib.axes import Axes

from benchmarks.common import command
from benchmarks.figures import by_scene, minutes, pair, pair_frames
from benchmarks.intervals.differences import paired_difference
from benchmarks.rows import POOL, Rows, read_source
from egosplat.drawing import label_log_axis, plt, save_figure
from egosplat_rivals.scored_scenes import FULL

CHEAPEST = "draft"
PRESETS = {"quick": "quick", "balanced": FULL, "accurate": "accurate"}

# Of each panel: what is drawn, and its unit in that of the rows.
PANELS = {"accuracy [points]": 100.0, "mIoU [points]": 100.0, "static PSNR, own size [dB]": 1.0}

# A difference, at most 1, is one of so many decibels.
_DECIBELS = 100.0


def gains(rows: Rows, setting: str) -> Iterator[tuple[str, int, list[float]]]:
    """The apartments and, in the order of ``PANELS``, gain, low, high of a setting over the cheapest; twice where other apartments
    have a wider interval."""
    frames = pair_frames(rows, setting, CHEAPEST, "static")
    found = [by_scene(pair(rows, setting, CHEAPEST, column), "difference") for column in ("hit", "iou")]
    found.append(by_scene(frames.assign(difference=frames["difference"] / _DECIBELS), "difference", "frame"))
    for (label, scale), scenes in zip(PANELS.items(), found, strict=True):
        mean, interval, _, wider = paired_difference(scenes)
        scale *= _DECIBELS if scenes is found[-1] else 1.0
        yield label, len(scenes), [scale * value for value in (mean, *interval, *(wider or interval))]


def draw(rows: Rows, output: Path) -> pd.DataFrame:
    """Draw a panel for each gain over CPU-minutes, as PNG; returns its points."""
    points = pd.DataFrame(
        [
            (preset, float(minutes(rows, setting)), label, scenes, *values)
            for preset, setting in PRESETS.items()
            for label, scenes, values in gains(rows, setting)
        ],
        columns=["preset", "minutes", "panel", "scenes", "gain", "low", "high", "t_low", "t_high"],
    )
    figure = plt.figure(figsize=(12, 4), layout="constrained")
    figure.suptitle(f"Gain over preset={CHEAPEST} ({minutes(rows, CHEAPEST)} CPU-minutes), same apartments")
    for axes, label in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        _draw_panel(axes, points[points["panel"] == label], float(minutes(rows, CHEAPEST)))
        axes.set(title=label)
    save_figure(figure, output)
    return points


def _draw_panel(axes: Axes, points: pd.DataFrame, start: float) -> None:
    axes.axhline(0.0, color="0.6", linewidth=1)
    axes.plot([start, *points["minutes"]], [0.0, *points["gain"]], "o-", color="tab:blue")
    axes.vlines(points["minutes"], points["low"], points["high"], color="tab:blue", linewidth=5, alpha=0.35)
    axes.vlines(points["minutes"], points["t_low"], points["t_high"], color="tab:blue", linewidth=1)
    for one in points.itertuples():
        place = (one.minutes, max(one.high, one.t_high))
        axes.annotate(
            f"{one.preset}\n{one.scenes} apartments",
            place,
            (0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    axes.set(xlabel="CPU-minutes", xscale="log", xlim=(start / 1.5, 2.5 * points["minutes"].max()))
    axes.margins(y=0.2)
    axes.grid(alpha=0.3)
    label_log_axis(axes.xaxis)


@command(__doc__)
@click.argument("output", type=click.Path(path_type=Path))
def main(output: Path) -> None:
    """Draw the picture, and print its points."""
    click.echo(draw(read_source(POOL), output).round(2).to_string(index=False))


if __name__ == "__main__":
    main()
