"""How often queries of what is not there are refused, and queries of what is there are not.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/metrics.json
    python benchmarks/presence.py results/adt/scene{1,2,3,4,5}

The limit ``query.min_score`` is chosen on the scenes given, but for untouched apartments: on these it is only reported.
Prints a table, and draws the curve with ``--picture``.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.evaluation.presence import separation
from egosplat.output_files import picture_kind
from egosplat.report.figure import plt, save_figure
from egosplat.tables.scored_scenes import ScoredScene, read_scored_scene

PICTURE = picture_kind("benchmarks/presence.py")

LIMITS = np.arange(0.30, 0.901, 0.05)


@dataclass(frozen=True)
class Asked:
    """Scores of queries over some scenes, those with untaught words left out.

    Attributes:
        present, right: (P,) scores of what is there, and which were right.
        absent: (A,) scores of what is not.
        untaught: queries that are refused for a word, whatever their score.
    """

    present: NDArray[np.float64]
    right: NDArray[np.bool_]
    absent: NDArray[np.float64]
    untaught: int

    def best_limit(self) -> float:
        """The limit of largest right answers less answers to what is absent, as shares; the smallest of equal ones."""
        limits = np.unique(np.r_[self.present, self.absent, 1.0])
        gains = [self.shares(limit)[1] - self.shares(limit)[2] for limit in limits]
        return float(limits[int(np.argmax(gains))])

    def shares(self, limit: float) -> tuple[float, float, float]:
        """Shares answered of what is there, rightly answered of it, and answered of what is not."""
        answered = self.present >= limit
        return (
            float(answered.mean()),
            float((answered & self.right).mean()),
            float((self.absent >= limit).mean()) if len(self.absent) else float("nan"),
        )


def gather(scenes: Sequence[ScoredScene]) -> Asked:
    """All queries of scenes."""
    rows = [row for scene in scenes for row in scene.document["presence"]["queries"]]
    present, absent = ([row for row in rows if row["present"] is there] for there in (True, False))
    taught = [row for row in absent if not row["untaught"]]
    if not present:
        raise UserError("no scene was asked for anything that is there")
    return Asked(
        present=np.array([row["score"] for row in present]),
        right=np.array([row["right"] is True for row in present]),
        absent=np.array([row["score"] for row in taught]),
        untaught=len(absent) - len(taught),
    )


def grouped(scenes: Sequence[ScoredScene]) -> dict[str, Asked]:
    """The queries of the scenes that a limit may be chosen on, and of untouched apartments; without empty groups."""
    named = {"tuning": False, "untouched": True}
    own = {name: [one for one in scenes if one.untouched is which] for name, which in named.items()}
    return {name: gather(chosen) for name, chosen in own.items() if chosen}


def table(groups: dict[str, Asked], limits: Sequence[float]) -> str:
    """One row a limit: shares in percent for each group of scenes."""
    titles = [f"{name}: {what}" for name in groups for what in ("answered", "rightly", "absent answered")]
    lines = [f"| least score | {' | '.join(titles)} |", "| --- |" + " ---: |" * len(titles)]
    for limit in limits:
        cells = [f"{100 * share:.1f}" for asked in groups.values() for share in asked.shares(limit)]
        lines.append(f"| {limit:.2f} | {' | '.join(cells)} |")
    return "\n".join(lines)


def summary(name: str, asked: Asked, limit: float) -> str:
    """The separation and the shares at a limit, in one sentence each."""
    answered, right, false = asked.shares(limit)
    area = separation(asked.present, asked.absent)
    return (
        f"- **{name}**: {len(asked.present)} things that are there, {len(asked.absent)} that are not, and "
        f"{asked.untaught} phrases with an untaught word, all refused. Area under the curve {area:.3f} "
        f"({separation(asked.present[asked.right], asked.absent):.3f} of what is found rightly). At {limit:.2f}: "
        f"{answered:.0%} of what is there is answered, {right:.0%} rightly, and {false:.0%} of what is not."
    )


def draw(groups: dict[str, Asked], limit: float, output: Path) -> None:
    """Draw answers to what is there, and right ones, against answers to what is not."""
    figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
    for number, (name, asked) in enumerate(groups.items()):
        curve = np.array(
            [asked.shares(at) for at in np.r_[0.0, np.unique(np.r_[asked.present, asked.absent]), 1.01]]
        )
        axes.step(curve[:, 2], curve[:, 0], color=f"C{number}", where="post", label=f"{name}: answered")
        axes.step(
            curve[:, 2],
            curve[:, 1],
            color=f"C{number}",
            linestyle=":",
            where="post",
            label=f"{name}: rightly",
        )
        there, right, false = asked.shares(limit)
        axes.plot([false, false], [there, right], "o", color=f"C{number}")
    axes.set(
        xlabel="share of absent things answered", ylabel="share of present things", xlim=(0, 1), ylim=(0, 1)
    )
    axes.set_title(f"Dots: least score {limit:.2f}")
    axes.legend(loc="lower right")
    save_figure(figure, output, PICTURE)


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--limit", type=float, help="Least score to report; by default the one chosen on the first scenes."
)
@click.option("--picture", type=click.Path(path_type=Path), help="PNG file to draw.")
def main(folders: tuple[Path, ...], limit: float | None, picture: Path | None) -> None:
    """Print the table."""
    groups = grouped([read_scored_scene(folder / "metrics.json") for folder in folders])
    if "tuning" not in groups:
        raise UserError("only untouched apartments are given, by which nothing is chosen; give others too")
    chosen = groups["tuning"].best_limit()
    limit = chosen if limit is None else limit
    click.echo("Queries of the whole scene: `benchmarks/presence.py`. Shares in percent.\n")
    click.echo(
        f"Largest gain of right answers over answers to what is absent, on the tuning scenes: at {chosen:.2f}.\n"
    )
    for name, asked in groups.items():
        click.echo(summary(name, asked, limit))
    click.echo(f"\n{table(groups, [float(one) for one in LIMITS])}")
    if picture:
        draw(groups, limit, picture)


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"presence.py: {error}")
