"""How often 95 % intervals hold the truth, and tests reject it, in simulated scenes.

    python -m benchmarks.intervals

Each category has one value in all of its queries: a score is hit or missed, a difference -1, 0 or 1. The share that is hit, and
the mean difference, vary between scenes by a normal distribution. What takes queries for independent stands beside: Wilson's
interval of scores, and McNemar's p of differences.
"""

from itertools import product

import click
import numpy as np
from scipy import stats

from benchmarks.common import command, markdown
from benchmarks.intervals.differences import paired_difference
from egosplat.evaluation.intervals import Clusters, clustered_interval, mean_of_scenes
from egosplat.progress import track

# Queries of a category, about as many as in the apartments.
FRAMES = 4

# Scenes, categories of each, share that is hit, standard deviation of the share between scenes.
SCORES = [
    *product((1,), (3, 6, 10, 22), (0.3, 0.55, 0.85), (0.0,)),
    *product((2, 5), (22,), (0.3, 0.55, 0.85), (0.0, 0.1, 0.2)),
]

# Scenes, categories of each, share that differs, standard deviation of the mean difference between scenes.
DIFFERENCES = [*product((1, 5, 10), (22,), (0.1, 0.3), (0.0,)), *product((5, 10), (22,), (0.3,), (0.05, 0.1))]

RESAMPLES = 1000

CASE = ["scenes", "categories", "share", "spread between scenes"]
SCORE = [*CASE, "over categories: held", "width", "over queries: held", "width"]
DIFFERENCE = [*CASE, "p < 0.05", "by McNemar", "held", "width", "with t: held", "width"]


def draw(rng: np.random.Generator, values: list[int], shares: np.ndarray, categories: int) -> list[Clusters]:
    """Scenes whose categories have one of the values in all of their queries, from (S, V) shares of the values."""
    counts = np.full(categories, float(FRAMES))
    return [Clusters(counts * rng.choice(values, categories, p=own), counts) for own in shares]


def over_queries(scenes: list[Clusters]) -> tuple[float, float]:
    """Wilson interval of all queries together."""
    count = int(sum(scene.counts.sum() for scene in scenes))
    found = stats.binomtest(round(mean_of_scenes(scenes) * count), count).proportion_ci(method="wilson")
    return found.low, found.high


def score_row(scenes: int, categories: int, share: float, spread: float, trials: int) -> list[str]:
    """A case's row: coverage and mean width of either interval."""
    rng = np.random.default_rng(0)
    truth = float(np.clip(rng.normal(share, spread, 1_000_000), 0, 1).mean())
    found = []
    for _ in range(trials):
        hit = np.clip(rng.normal(share, spread, scenes), 0, 1)
        drawn = draw(rng, [0, 1], np.stack([1 - hit, hit], 1), categories)
        found.append((clustered_interval(drawn, RESAMPLES), over_queries(drawn)))
    return [str(each) for each in (scenes, categories, share, spread)] + held(np.array(found), truth)


def difference_row(scenes: int, categories: int, share: float, spread: float, trials: int) -> list[str]:
    """A case's row: how often no difference is rejected, by ``paired_difference`` and by McNemar's exact test, and coverage."""
    rng = np.random.default_rng(0)
    rejected, found = [], []
    for _ in range(trials):
        mean = np.clip(rng.normal(0, spread, scenes), -share, share)
        shares = np.stack([(share - mean) / 2, np.full(scenes, 1 - share), (share + mean) / 2], 1)
        drawn = draw(rng, [-1, 0, 1], shares, categories)
        _, interval, p, over_scenes = paired_difference(drawn, RESAMPLES)
        totals = np.concatenate([each.totals for each in drawn])
        gained, lost = int(totals[totals > 0].sum()), int(-totals[totals < 0].sum())
        mcnemar = stats.binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
        rejected.append((p < 0.05, mcnemar < 0.05))
        found.append((interval, over_scenes or interval))
    rates = [f"{rate:.2f}" for rate in np.mean(rejected, axis=0)]
    return [str(each) for each in (scenes, categories, share, spread)] + rates + held(np.array(found), 0.0)


def held(bounds: np.ndarray, truth: float) -> list[str]:
    """Share of (T, I, 2) bounds that hold the truth, and their mean width, for each of I intervals."""
    inside = ((bounds[..., 0] <= truth) & (truth <= bounds[..., 1])).mean(axis=0)
    width = np.diff(bounds, axis=2)[..., 0].mean(axis=0)
    return [f"{number:.2f}" for pair in zip(inside, width, strict=True) for number in pair]


@command(__doc__)
@click.option("--trials", default=1000, show_default=True)
def main(trials: int) -> None:
    """Print both tables."""
    for columns, row, cases in ((SCORE, score_row, SCORES), (DIFFERENCE, difference_row, DIFFERENCES)):
        rows = [row(*case, trials) for case in track(cases, "drawing")]
        click.echo(f"{markdown(columns, rows, words=0)}\n")


if __name__ == "__main__":
    main()
