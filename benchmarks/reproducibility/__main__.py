"""What of a scene is the same on another processor: each stage of a small scene under the libraries' limits.

    python -m benchmarks.reproducibility --work /tmp/reproducibility > docs/reproducibility.md

Needs a processor with AVX-512, and about 25 minutes of two cores. A run that was ended goes on with the limit it was at. The reading
below the tables is written by hand, in benchmarks.reproducibility/reading.md.
"""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import click

from benchmarks.reproducibility.chain import INPUTS, file_of, run_chain
from benchmarks.reproducibility.comparing import Difference, differences
from benchmarks.reproducibility.limits import LIMITS, REFERENCE, Limit, choices
from egosplat.artifacts import usage
from egosplat.errors import UserError
from egosplat.progress import log

READING = Path(__file__).with_name("reading.md")


def folder_of(work: Path, limit: Limit) -> Path:
    """Where a limit's artifacts lie."""
    return work / limit.name.replace(" ", "_").replace(",", "")


def ensure(work: Path, limit: Limit) -> None:
    """Run the chain in a process of its own, unless it has been."""
    if (folder_of(work, limit) / "choices.json").exists():
        return
    environment = {"OMP_NUM_THREADS": "1"} | limit.variables
    command = [sys.executable, "-m", "benchmarks.reproducibility", "--work", str(work), "--only", limit.name]
    done = subprocess.run(command, env=os.environ | environment, stdout=sys.stderr, check=False)
    if done.returncode:
        raise UserError(f"the stages under {limit.name!r} ended with status {done.returncode}")


def run_limited(work: Path, name: str) -> None:
    """The stages in this process, whose environment has the limit's variables."""
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


def told(found: Difference) -> str:
    """One difference in words."""
    size = "" if found.largest is None else f", at most {found.largest:.1e} of the largest value"
    return f"`{found.name}` ({100 * found.share:.3g} %{size})"


def page(work: Path) -> str:
    """The page in Markdown."""
    chosen = {
        limit.name: json.loads((folder_of(work, limit) / "choices.json").read_text())
        for limit in (REFERENCE, *LIMITS)
    }
    found = {limit.name: compared(work, limit) for limit in LIMITS}
    names = [limit.name for limit in LIMITS]
    table = [
        f"| made by | {' | '.join(names)} |",
        f"| --- |{' --- |' * len(names)}",
        *(f"| `{stage}` | {' | '.join(cell(found[name][stage]) for name in names)} |" for stage in INPUTS),
    ]
    details = [
        f"- `{stage}`, {name}: {'; '.join(told(one) for one in largest(every))}"
        for stage in INPUTS
        for name in names
        if (every := found[name][stage])
    ]
    variables = [
        f"| {limit.name} | {_variables(limit)} | {_chosen(chosen[limit.name])} |"
        for limit in (REFERENCE, *LIMITS)
    ]
    return "\n".join(
        [
            "# Which results are the same on another processor",
            "",
            f"Written by `python -m benchmarks.reproducibility` on: {usage.machine()}.",
            "",
            READING.read_text().strip(),
            "",
            "## Each stage under each limit",
            "",
            "Each stage was given the artifacts of the reference run, so a cell tells of that stage alone. In the last",
            "column each stage was given what the stages before it had made under the same limits. `equal`: every",
            "stored value is the same to the last bit. A number: the largest difference, as a share of the largest",
            "value of the same array. `differs`: labels, counts or words, which have no such number.",
            "",
            *table,
            "",
            "## Scores of the whole chain",
            "",
            "| | queries hit | mIoU | PSNR of what stays |",
            "| --- | ---: | ---: | ---: |",
            *(scores(work, limit) for limit in (REFERENCE, LIMITS[-1])),
            "",
            "## What the limits are",
            "",
            "| limit | environment | what the libraries then chose |",
            "| --- | --- | --- |",
            *variables,
            "",
            "oneDNN and MKL do not tell what they chose. The ray caster of the `synthetic` stage has one variant, and",
            "JPEG and video codecs compute with integers.",
            "",
            "## The differences, array by array",
            "",
            "Share of the values that differ; of each stage and limit the two arrays that differ most.",
            "",
            *details,
        ]
    )


def largest(found: list[Difference]) -> list[Difference]:
    """The two that differ most: by their size, then by how many values."""
    return sorted(found, key=lambda one: (-(one.largest or 0), -one.share))[:2]


def scores(work: Path, limit: Limit) -> str:
    """A row of what metrics.json says of all queries."""
    document = json.loads((folder_of(work, limit) / "metrics.json").read_text())
    every, quality = document["scores"]["all"], document["rendering"]["static"]
    return (
        f"| {limit.name} | {round(every['accuracy'] * every['count'])} of {every['count']} "
        f"| {every['mean_iou']:.3f} | {quality['psnr']:.2f} dB |"
    )


def _variables(limit: Limit) -> str:
    return ", ".join(f"`{name}={value}`" for name, value in limit.variables.items()) or "-"


def _chosen(values: dict[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())


@click.command(help=__doc__)
@click.option("--work", required=True, type=click.Path(path_type=Path), help="Folder of the artifacts.")
@click.option("--only", help="Run the stages under this limit alone, in this process; the script's own use.")
def main(work: Path, only: str | None) -> None:
    """Print the page."""
    if only:
        run_limited(work, only)
        return
    for limit in (REFERENCE, *LIMITS):
        log(limit.name)
        ensure(work, limit)
    (work / "differences.json").write_text(
        json.dumps(
            {
                limit.name: {s: [asdict(one) for one in f] for s, f in compared(work, limit).items()}
                for limit in LIMITS
            },
            indent=1,
        )
    )
    click.echo(page(work))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"reproducibility.py: {error}")
