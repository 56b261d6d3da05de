"""Scores of seven apartments that nobody has seen: drawn from a text, run once, and kept with every row.

    python -m benchmarks.ledger TEXT                 # draw, run, score, and write benchmarks/ledger/TEXT/
    python -m benchmarks.ledger TEXT draft accurate  # the same, of these settings and the default's
    python -m benchmarks.ledger --report             # every table and interval from the rows, of each text and pooled

A text is committed to benchmarks/ledger/texts.tsv before it is run, and run once. A run needs a clean checkout of one commit to
its end: take a worktree of its own. The same command goes on after an interruption. Commit its folder.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import click
import yaml

from benchmarks.common import ROOT, command
from benchmarks.figures import TABLES
from benchmarks.rows import (
    AS_GIVEN,
    LEDGER,
    POOL,
    TEXTS,
    collect,
    head,
    read_rows,
    read_scenes,
    read_source,
    read_texts,
    stamp,
    world_of,
    write_rows,
)
from egosplat.errors import UserError
from egosplat.pipeline.variants import variant_folder
from egosplat_rivals.scored_scenes import FULL, ScoredScene

# Methods whose codes are also asked by pixels.
BY_PIXELS = ("occam", "semantic_gaussians", "gags", "langsplat", "langsplat2", "splat_feature_solver")

# Variant of each setting, None for the scene's own: one that the workflow knows, or one of CONFIGURATION.
SETTINGS: dict[str, str | None] = {
    FULL: None,
    "full_pixels": "pixels",
    **{name: name for name in (AS_GIVEN, "no_sizes", "draft", "quick", "accurate", "baseline")},
    **{name: name for name in ("lerf", "legaussians")},
    **{name: name for method in BY_PIXELS for name in (method, f"{method}_pixels")},
}

# Configuration of all runs: what differs from the defaults.
CONFIGURATION: dict[str, Any] = {
    "synthetic": {"camera": "real"},
    "variants": {AS_GIVEN: {"metrics": {"held_out": "given"}}},
}

# Worlds of the apartments in the order of the draw, and the options of each beside the seed.
DRAW = ("usual", "usual", "usual", "busy", "busy", "foreign", "foreign")
WORLDS = {
    "usual": "",
    "busy": " synthetic.world=busy synthetic.objects=28 synthetic.seconds=28 synthetic.fps=4 synthetic.motion=0.87",
    "foreign": " synthetic.world=foreign",
}

# Smaller seeds are those of the table of scenes, benchmarks, tests and training (training/small_models/worlds.py).
FIRST_SEED, LAST_SEED = 10_000_000, 999_999_999

# Where scenes are made: ignored by git, a folder for each text and commit.
WORK = ROOT / "ledger"


def draw_seeds(text: str, taken: Collection[int] = (), count: int = len(DRAW)) -> list[int]:
    """Seeds of apartments for a text: the same for everybody, and none of ``taken`` or twice."""
    seeds: list[int] = []
    number = 0
    while len(seeds) < count:
        digest = hashlib.sha256(f"egosplat ledger\n{text}\n{number}".encode()).digest()
        seed = FIRST_SEED + int.from_bytes(digest[:8], "big") % (LAST_SEED - FIRST_SEED + 1)
        if seed not in taken and seed not in seeds:
            seeds.append(seed)
        number += 1
    return seeds


def git(*words: str) -> str:
    """What git says in the folder of the ledger."""
    return subprocess.run(["git", *words], cwd=LEDGER, check=True, capture_output=True, text=True).stdout


def registered() -> list[str]:
    """The texts that the commit registers.

    Raises:
        UserError: an earlier commit has a line that this one has not, or has elsewhere.
    """
    now = git("show", f"HEAD:./{TEXTS}")
    for commit in git("log", "--full-history", "--diff-filter=AM", "--format=%h", "--", TEXTS).split():
        if not now.startswith(git("show", f"{commit}:./{TEXTS}")):
            raise UserError(
                f"{LEDGER / TEXTS}: lacks lines of commit {commit}; lines are only added at its end"
            )
    return [line.split("\t")[0] for line in now.splitlines()[1:]]


def check_text(text: str) -> str:
    """Check that a text may be run; returns the commit to run.

    Raises:
        UserError: it was run, or the commit does not register it; or the checkout is not clean. See also ``registered``.
    """
    if (LEDGER / text).exists():
        raise UserError(
            f"{text}: was run already, see benchmarks/ledger/{text}; a text is run once. Register another"
        )
    commit = head()
    if text not in registered():
        raise UserError(f"{text}: is not registered; first commit a line for it in benchmarks/ledger/{TEXTS}")
    return commit


def prepare(folder: Path, scenes: Mapping[str, int]) -> None:
    """Write the configuration of a run: a table of apartments from their seeds by name, and the keys of all of them."""
    (folder / "config").mkdir(parents=True, exist_ok=True)
    rows = ["dataset\tscene\tformat\trecording\toptions"]
    for name, seed in scenes.items():
        rows.append(f"ledger\t{name}\tadt\t-\tsynthetic.seed={seed}{WORLDS[world_of(name)]}")
    (folder / "config/scenes.tsv").write_text("\n".join(rows) + "\n")
    (folder / "config/config.yaml").write_text(yaml.safe_dump(CONFIGURATION))


def snakemake(folder: Path, cores: int, targets: Collection[str], *more: str) -> int:
    """Make targets in the folder of a run; returns the exit status. Snakemake shows the progress."""
    words = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "workflow/Snakefile")]
    words += ["--cores", str(cores), "--rerun-incomplete", *more, "--", *targets]
    return subprocess.run(words, cwd=folder, check=False, stdout=sys.stderr).returncode


def check_commit(scenes: Collection[ScoredScene], commit: str) -> None:
    """Check that every artifact of every scene was written by the clean checkout of a commit.

    Raises:
        UserError: one was not, and the row would tell of other code.
    """
    for scene in scenes:
        made = {"metrics.json": scene.document["provenance"], **scene.document["artifacts"]}
        for name, record in made.items():
            if record is None or record.get("commit") != commit or not record["clean"]:
                raise UserError(
                    f"{scene.path}: {name} was not made by the clean commit {commit[:12]}; "
                    f"remove {scene.path.parent} and run the command again, without editing the checkout"
                )


def run(text: str, asked: Collection[str], cores: int) -> Path:
    """Draw, run and score the apartments of a text with settings, and write its entry.

    Raises:
        UserError: see ``check_text`` and ``check_commit``; or a job failed.
    """
    commit = check_text(text)
    settings = {name: SETTINGS[name] for name in SETTINGS if name in {FULL, *asked}}
    taken = {
        seed for one in read_texts().query("ran")["text"] for seed in read_rows(LEDGER / one).about["seeds"]
    }
    seeds, folder = draw_seeds(text, taken), WORK / f"{text}-{commit[:12]}"
    scenes = {f"{world}{seed}": seed for world, seed in zip(DRAW, seeds, strict=True)}
    prepare(folder, scenes)
    folders = [variant_folder(variant) for variant in settings.values()]
    targets = [f"results/ledger/{scene}/{variant}metrics.json" for scene in scenes for variant in folders]
    if status := snakemake(folder, cores, targets):
        raise UserError(
            f"{folder}: a job failed (exit {status}); see above. The same command goes on from there"
        )
    found = read_scenes([folder / "results/ledger" / scene for scene in scenes], settings)
    check_commit([one for own in found.values() for one in own], commit)
    told = {"seeds": seeds, "configuration": CONFIGURATION | {"worlds": WORLDS}}
    write_rows(LEDGER / text, collect(text, found, text=text, commit=commit, **told))
    return LEDGER / text


def report(text: str) -> str:
    """Every table of a text, over all apartments and over those of each world, or that it has not run; also of ``POOL``."""
    if text != POOL and not (LEDGER / text).exists():
        return f"# {text}\n\nRegistered, not run."
    rows = read_source(text)
    worlds = [None, *rows.worlds] if len(rows.worlds) > 1 else [None]
    told = [
        line
        for world in worlds
        for line in (*([f"## {world}"] if world else []), *(table(rows, world) for table in TABLES.values()))
    ]
    return "\n\n".join([f"# {rows.about['name']}", stamp(rows.about), *told])


@command(__doc__)
@click.argument("text", required=False)
@click.argument("settings", nargs=-1, type=click.Choice([*SETTINGS]))
@click.option("--report", "reported", is_flag=True, help="Print the tables of TEXT, or of all texts.")
@click.option("--cores", default=len(os.sched_getaffinity(0)), show_default=True, help="Of Snakemake.")
def main(text: str | None, settings: tuple[str, ...], reported: bool, cores: int) -> None:
    """Run a text, or report; without SETTINGS all are run."""
    if not reported and text is None:
        raise UserError("give a TEXT to run, or --report")
    if not reported:
        click.echo(f"wrote {run(text, settings or SETTINGS, cores)}; commit it", err=True)
    click.echo("\n\n".join(map(report, [text] if text else [POOL, *read_texts()["text"]])))


if __name__ == "__main__":
    main()
