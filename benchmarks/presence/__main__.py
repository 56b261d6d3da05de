"""How many scene queries are answered and refused, for things that are present and for things that are absent.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/metrics.json
    python -m benchmarks.presence results/adt/scene{1,2,3,4,5}

Chooses the limit `query.min_score` on the given scenes. Apartments kept for reporting only never take part in the choice.
Prints a table; `--picture` draws the curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import command, markdown, scene_folders
from benchmarks.rows import collect_page, rows_option
from egosplat.drawing import plt, save_figure
from egosplat.errors import UserError
from egosplat.evaluation.presence import separation
from egosplat.evaluation.scored_scenes import FULL, ScoredScene, read_scored_scene

LIMITS = np.arange(0.30, 0.901, 0.05)


@dataclass(frozen=True)
class Asked:
    """Scores of the queries of some scenes, without queries that hold an untaught word.

    Attributes:
        present, right: (P,) scores of present things, and whether the answer was right.
        absent: (A,) scores of absent things.
        untaught: number of queries refused because of an untaught word, whatever their score.
    """

    present: NDArray[np.float64]
    right: NDArray[np.bool_]
    absent: NDArray[np.float64]
    untaught: int

    def best_limit(self) -> float:
        """The limit with the largest share of right answers minus share of answers to absent things.

        Of several such limits it is the smallest.
        """
        limits = np.unique(np.r_[self.present, self.absent, 1.0])
        gains = [self.shares(limit)[1] - self.shares(limit)[2] for limit in limits]
        return float(limits[int(np.argmax(gains))])

    def shares(self, limit: float) -> tuple[float, float, float]:
        """Shares of present things answered, of present things answered rightly, and of absent things answered."""
        answered = self.present >= limit
        return (
            float(answered.mean()),
            float((answered & self.right).mean()),
            float((self.absent >= limit).mean()) if len(self.absent) else float("nan"),
        )


def gather(scenes: Sequence[ScoredScene]) -> Asked:
    """Collect the queries of scenes.

    Raises:
        UserError: no scene has a query for a present thing.
    """
    rows = [row for scene in scenes for row in scene.document["presence"]["queries"]]
    present, absent = ([row for row in rows if row["present"] is there] for there in (True, False))
    taught = [row for row in absent if not row["untaught"]]
    if not present:
        raise UserError("no scene has queries for present things")
    return Asked(
        present=np.array([row["score"] for row in present]),
        right=np.array([row["right"] is True for row in present]),
        absent=np.array([row["score"] for row in taught]),
        untaught=len(absent) - len(taught),
    )


def grouped(scenes: Sequence[ScoredScene]) -> dict[str, Asked]:
    """Queries of the scenes for tuning and of validation apartments; a group without scenes is left out."""
    own = {
        name: [one for one in scenes if one.validation is which]
        for name, which in {"tuning": False, "validation": True}.items()
    }
    return {name: gather(chosen) for name, chosen in own.items() if chosen}


def table(groups: dict[str, Asked], limits: Sequence[float]) -> str:
    """A row for each limit: shares in percent for each group of scenes."""
    kinds = ("answered", "rightly", "absent answered")
    rows = [
        [f"{limit:.2f}", *(f"{100 * share:.1f}" for one in groups.values() for share in one.shares(limit))]
        for limit in limits
    ]
    return markdown(["least score", *(f"{name}: {kind}" for name in groups for kind in kinds)], rows)


def summary(name: str, asked: Asked, limit: float) -> str:
    """Counts, separation and shares of one group at a limit, as a list item."""
    answered, right, false = asked.shares(limit)
    return (
        f"- **{name}**: {len(asked.present)} present things, {len(asked.absent)} absent ones, and {asked.untaught} "
        "phrases with an untaught word, all refused. Area under the curve "
        f"{separation(asked.present, asked.absent):.3f} ({separation(asked.present[asked.right], asked.absent):.3f} over "
        f"rightly found things). At {limit:.2f}, {answered:.0%} of present things are answered, {right:.0%} rightly, and "
        f"{false:.0%} of absent ones are answered."
    )


def draw(groups: dict[str, Asked], limit: float, output: Path) -> None:
    """Draw the answered and the rightly answered share of present things against that of absent things."""
    figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
    for number, (name, asked) in enumerate(groups.items()):
        limits = np.r_[0.0, np.unique(np.r_[asked.present, asked.absent]), 1.01]
        answered, right, false = np.array([asked.shares(at) for at in limits]).T
        style = {"color": f"C{number}", "where": "post"}
        axes.step(false, answered, **style, label=f"{name}: answered")
        axes.step(false, right, **style, linestyle=":", label=f"{name}: rightly")
        here, right_here, false_here = asked.shares(limit)
        axes.plot([false_here, false_here], [here, right_here], "o", color=f"C{number}")
    axes.set(
        title=f"Dots: least score {limit:.2f}",
        xlabel="share of absent things answered",
        ylabel="share of present things",
        xlim=(0, 1),
        ylim=(0, 1),
    )
    axes.legend(loc="lower right")
    save_figure(figure, output)


@command(__doc__)
@scene_folders
@click.option("--limit", type=float, help="Least score to report; by default the chosen one.")
@click.option("--picture", type=click.Path(path_type=Path), help="PNG file to draw.")
@rows_option
def main(folders: tuple[Path, ...], limit: float | None, picture: Path | None, rows: Path | None) -> None:
    """Print the table."""
    groups = grouped([read_scored_scene(folder / "metrics.json") for folder in folders])
    if "tuning" not in groups:
        raise UserError("all given apartments are for validation; give others too, to choose the limit on")
    chosen = groups["tuning"].best_limit()
    limit = chosen if limit is None else limit
    collect_page("presence", folders, {FULL: None}, rows)
    click.echo("Queries of whole scenes: `python -m benchmarks.presence`. Shares in percent.\n")
    click.echo(
        f"Limit with the most right answers minus answers to absent things, on the tuning scenes: {chosen:.2f}.\n"
    )
    for name, asked in groups.items():
        click.echo(summary(name, asked, limit))
    click.echo(f"\n{table(groups, [float(one) for one in LIMITS])}")
    if picture:
        draw(groups, limit, picture)


if __name__ == "__main__":
    main()
