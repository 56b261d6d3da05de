"""How queries of whole scenes are graded, for things that are present and for things that are absent.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/metrics.json
    python -m benchmarks.presence results/adt/scene{1,2,3,4,5} --fit

Fits the probability that an answer is right, prints how well it holds in scenes that the fit has not seen, each left out in
turn, and the three grades with it, for readers of whose words different shares are there. Without folders, the committed rows are taken. Apartments kept for reporting only never
take part in a fit.
"""

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
import pandas as pd

from benchmarks.common import command, markdown
from benchmarks.presence.fit import EVIDENCE, at_share, brier, held_out, judged, log_loss, reliability
from benchmarks.rows import Rows, collect_page, read_source, rows_option, stamp
from egosplat.errors import UserError
from egosplat.evaluation.options import recorded_options
from egosplat.query.calibrate import write_fit
from egosplat.query.grades import FITS, LEAST_FOUND, LEAST_GUESS, held_keys
from egosplat_rivals.scored_scenes import FULL, VALIDATION, ScoredScene, read_scored_scene

# Shares of the words of readers that name what is there; the fit's own is near the first.
SHARES = (0.42, 0.7, 0.9)

# Evidence that the fit is compared with.
LESS = (("fit",), ("fit", "apart"), EVIDENCE)


def asked_of(rows: Rows) -> pd.DataFrame:
    """The queries of the scenes' own settings that tell whether their answer is right, but for validation apartments.

    Raises:
        UserError: fewer than two scenes with such queries are left.
    """
    asked = judged(rows.of("presence", FULL)).reset_index(drop=True)
    asked = asked[~asked["scene"].str.split("/").str[-1].isin(VALIDATION)]
    if asked["scene"].nunique() < 2:
        raise UserError("two scenes with judged answers are needed: each is predicted by a fit on the others")
    return asked


def shares_table(asked: pd.DataFrame, p: pd.Series) -> str:
    """What a reader meets of whose words a share is there, by probabilities of the fit and by those for this share."""
    table, present = [], asked["present"] == 1
    for share in SHARES:
        shifted, weight = at_share(p, asked, share)
        for name, own in (("the fit's", p), ("the reader's", shifted)):
            told = [own >= least for least in (LEAST_FOUND, LEAST_GUESS)]
            right = [(asked["true"] * weight)[one].sum() / (weight[one].sum() or np.nan) for one in told]
            recall = [asked["true"][present & one].sum() / present.sum() for one in told]
            absent = [(one & ~present).sum() / (~present).sum() for one in told]
            cells = np.stack([right, recall, absent]).T.ravel()
            table.append([f"{100 * share:.0f} %", name, *(f"{100 * cell:.0f}" for cell in cells)])
    kinds = ("right", "of present", "of absent")
    columns = [*(f"found: {one}" for one in kinds), *(f"with guesses: {one}" for one in kinds)]
    return markdown(["present", "probabilities", *columns], table)


def reliability_table(asked: pd.DataFrame, p: pd.Series) -> str:
    """How often answers are right, by their probability."""
    rows = [
        [f"{low:.1f} to {high:.1f}", count, f"{mean:.2f}", f"{right:.2f}"]
        for low, high, mean, right, count in reliability(p, asked["true"])
    ]
    return markdown(("probability", "queries", "mean", "right"), rows)


def evidence_table(asked: pd.DataFrame) -> str:
    """Log-likelihood and Brier score in scenes left out, with less evidence and with all."""
    true = asked["true"]
    none = true.groupby(asked["scene"]).transform(lambda own: true.drop(own.index).mean())
    rows = [("none", none), *((", ".join(names), held_out(asked, names)) for names in LESS)]
    table = [[name, f"{log_loss(p, true):.3f}", f"{brier(p, true):.3f}"] for name, p in rows]
    return markdown(("evidence", "log loss", "Brier score"), table)


def fitted(rows: Rows) -> str:
    """How grades and probabilities hold in scenes left out."""
    asked = asked_of(rows)
    p = held_out(asked)
    return f"{shares_table(asked, p)}\n\n{reliability_table(asked, p)}"


def write_fits(scenes: Sequence[ScoredScene], asked: pd.DataFrame) -> None:
    """Write the fit on all rows beside the code, in place of that of the same OpenCLIP.

    Raises:
        UserError: the scenes have different OpenCLIPs or keys of queries.
    """
    documents = [one.document for one in scenes]
    clips = {one["models"]["clip_checkpoint"]["hash"] for one in documents}
    options = [recorded_options(one["provenance"]["options"]) for one in documents]
    if len(clips) != 1 or any(held_keys(one) != held_keys(options[0]) for one in options):
        raise UserError("a fit holds for one OpenCLIP and one section query; the scenes have several")
    about = clips.pop(), options[0], " ".join(asked["scene"].unique())
    write_fit(FITS, about, *(asked[one].to_numpy(float) for one in ([*EVIDENCE], "true", "present")))


@command(__doc__)
@click.argument("folders", nargs=-1, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--fit", is_flag=True, help=f"Write the fit into {FITS.name}.")
@rows_option
def main(folders: tuple[Path, ...], fit: bool, rows: Path | None) -> None:
    """Print the tables."""
    if folders:
        found = collect_page("presence", folders, {FULL: None}, rows)
    else:
        found = read_source("presence")
        click.echo(f"{stamp(found.about)}\n")
    asked = asked_of(found)
    click.echo(f"{fitted(found)}\n\n{evidence_table(asked)}\n")
    if fit:
        if not folders:
            raise UserError(
                "--fit takes folders of scenes: their metrics.json tells the OpenCLIP and the keys"
            )
        write_fits([read_scored_scene(folder / "metrics.json") for folder in folders], asked)


if __name__ == "__main__":
    main()
