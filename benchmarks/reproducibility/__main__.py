"""Equality of results on another processor: each stage of a small scene, with limits on the libraries' instructions.

    python -m benchmarks.reproducibility --work /tmp/reproducibility > benchmarks/reproducibility/README.md

Needs a processor with AVX-512, and about 25 minutes of two cores. A run that was ended goes on with the limit it was at. The reading
below the tables is written by hand, in benchmarks.reproducibility/reading.txt.
"""

import json
import shutil
from pathlib import Path
from string import Template

import click

from benchmarks.common import command, markdown, output_of
from benchmarks.reproducibility.chain import INPUTS, file_of, run_chain
from benchmarks.reproducibility.comparing import Difference, differences
from benchmarks.reproducibility.limits import LIMITS, REFERENCE, Limit, choices
from egosplat.artifacts import provenance
from egosplat.progress import log


def folder_of(work: Path, limit: Limit) -> Path:
    """Folder of a limit's artifacts."""
    return work / limit.name.replace(" ", "_").replace(",", "")


def ensure(work: Path, limit: Limit) -> None:
    """Run the stages in a process of their own, unless they have run before."""
    if not (folder_of(work, limit) / "choices.json").exists():
        environment = {"OMP_NUM_THREADS": "1"} | limit.variables
        output_of("benchmarks.reproducibility", "--work", work, "--only", limit.name, **environment)


def run_limited(work: Path, name: str) -> None:
    """Run the stages in this process, whose environment has the limit's variables."""
    limit = next(limit for limit in (REFERENCE, *LIMITS) if limit.name == name)
    alone = limit is REFERENCE or limit.chain
    folder = folder_of(work, limit)
    shutil.rmtree(folder, ignore_errors=True)
    chosen = choices()
    run_chain(folder, None if alone else folder_of(work, REFERENCE))
    (folder / "choices.json").write_text(json.dumps(chosen, indent=2))


def compared(work: Path, limit: Limit) -> dict[str, list[Difference]]:
    """Each stage's differences from the reference."""
    pairs = ((folder_of(work, one) for one in (REFERENCE, limit)) for _ in INPUTS)
    return {
        stage: differences(*(folder / file_of(stage) for folder in folders))
        for stage, folders in zip(INPUTS, pairs, strict=True)
    }


def cell(found: list[Difference]) -> str:
    """A cell of the table: equal, or the largest difference."""
    if not found:
        return "equal"
    numbers = [one.largest for one in found if one.largest is not None]
    return f"{max(numbers):.0e}" if numbers else "differs"


def scores(work: Path, limit: Limit) -> list[str]:
    """A row of the scores in metrics.json."""
    document = json.loads((folder_of(work, limit) / "metrics.json").read_text())
    every, quality = document["scores"]["all"], document["rendering"]["static"]
    hit = f"{round(every['accuracy'] * every['count'])} of {every['count']}"
    return [limit.name, hit, f"{every['mean_iou']:.3f}", f"{quality['psnr']:.2f} dB"]


def settings(work: Path, limit: Limit) -> list[str]:
    """A row of the environment of a limit and the code that the libraries chose."""
    chosen = json.loads((folder_of(work, limit) / "choices.json").read_text())
    variables = ", ".join(f"`{name}={value}`" for name, value in limit.variables.items()) or "-"
    return [limit.name, variables, ", ".join(f"{name} {value}" for name, value in chosen.items())]


def page(work: Path) -> str:
    """The page in Markdown."""
    found = {limit.name: compared(work, limit) for limit in LIMITS}
    stages = [[f"`{stage}`", *(cell(one[stage]) for one in found.values())] for stage in INPUTS]
    text = Path(__file__).with_name("reading.txt").read_text().strip()
    places = {
        "MACHINE": provenance.machine(),
        "STAGES": markdown(["stage", *found], stages, words=1 + len(found)),
        "SCORES": markdown(
            ["", "queries hit", "mIoU", "static PSNR"], [scores(work, one) for one in (REFERENCE, LIMITS[-1])]
        ),
        "LIMITS": markdown(
            ["limit", "environment", "chosen by the libraries"],
            [settings(work, one) for one in (REFERENCE, *LIMITS)],
            words=3,
        ),
    }
    return Template(text).substitute(places)


@command(__doc__)
@click.option("--work", required=True, type=click.Path(path_type=Path), help="Folder of the artifacts.")
@click.option("--only", hidden=True, help="Run the stages under this limit in this process.")
def main(work: Path, only: str | None) -> None:
    """Print the page."""
    if only:
        run_limited(work, only)
        return
    for limit in (REFERENCE, *LIMITS):
        log(limit.name)
        ensure(work.resolve(), limit)
    click.echo(page(work))


if __name__ == "__main__":
    main()
