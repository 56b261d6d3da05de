"""Coverage of 95 % intervals in simulated scenes where all queries of a category are hit or missed together.

    python -m benchmarks.intervals > benchmarks/intervals/README.md

Each drawn category is hit in all of its frames or in none. The share of hit categories varies between scenes by a normal
distribution. The page compares egosplat's intervals over categories with Wilson intervals over queries, which assume that
queries are independent.
"""

from itertools import product

import click
import numpy as np
from scipy import stats

from benchmarks.common import command, markdown
from egosplat.evaluation.intervals import Clusters, IntervalOptions, clustered_interval, mean_of_scenes
from egosplat.progress import track

# Queries of a category, about as many as in the apartments.
FRAMES = 4

# Scenes, categories of each, share that is hit, standard deviation of the share between scenes.
CASES = [
    *product((1,), (3, 6, 10, 22), (0.3, 0.55, 0.85), (0.0,)),
    *product((2, 5), (22,), (0.3, 0.55, 0.85), (0.0, 0.1, 0.2)),
]

OPTIONS = IntervalOptions(confidence=0.95, resamples=1000, seed=0)

COLUMNS = (
    "scenes",
    "categories of each",
    "share hit",
    "its standard deviation between scenes",
    "over categories: coverage",
    "width",
    "over queries (Wilson): coverage",
    "width",
)


def draw(
    rng: np.random.Generator, scenes: int, categories: int, share: float, spread: float
) -> list[Clusters]:
    """Scenes whose categories are hit in all of their frames, or in none."""
    shares = np.clip(rng.normal(share, spread, scenes), 0, 1)
    return [
        Clusters(FRAMES * (rng.random(categories) < own), np.full(categories, float(FRAMES)))
        for own in shares
    ]


def over_queries(scenes: list[Clusters]) -> tuple[float, float]:
    """Wilson interval of all queries together."""
    count = int(sum(scene.counts.sum() for scene in scenes))
    found = stats.binomtest(round(mean_of_scenes(scenes) * count), count).proportion_ci(method="wilson")
    return found.low, found.high


def row(scenes: int, categories: int, share: float, spread: float, trials: int) -> list[str]:
    """A case's row: coverage and mean width of either interval."""
    rng = np.random.default_rng(0)
    truth = float(np.clip(rng.normal(share, spread, 1_000_000), 0, 1).mean())
    found: dict[str, list[tuple[float, float]]] = {"categories": [], "queries": []}
    for _ in range(trials):
        drawn = draw(rng, scenes, categories, share, spread)
        interval = clustered_interval(drawn, OPTIONS)
        found["categories"].append((interval.low, interval.high))
        found["queries"].append(over_queries(drawn))
    cells = [str(one) for one in (scenes, categories, share, spread)]
    for bounds in map(np.array, found.values()):
        held = (bounds[:, 0] <= truth) & (truth <= bounds[:, 1])
        cells += [f"{held.mean():.2f}", f"{np.diff(bounds).mean():.2f}"]
    return cells


@command(__doc__)
@click.option("--trials", default=1000, show_default=True)
def main(trials: int) -> None:
    """Print the table."""
    rows = [row(*case, trials) for case in track(CASES, "drawing")]
    click.echo(
        f"# Coverage of the intervals\n\n`python -m benchmarks.intervals`: {trials} draws of each case, {FRAMES} queries of a "
        "category, all hit or all missed; confidence 0.95. Coverage is the share of draws whose interval holds the true "
        f"value.\n\n{markdown(COLUMNS, rows, words=0)}"
    )


if __name__ == "__main__":
    main()
