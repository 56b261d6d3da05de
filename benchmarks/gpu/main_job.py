"""The main job on a GPU at two sizes, and on the CPU: time and memory of every stage, and scores."""

import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from benchmarks.common import ROOT, markdown
from benchmarks.figures import METHOD, score_table
from benchmarks.rows import collect, read_scenes
from egosplat.errors import UserError
from egosplat_rivals.scored_scenes import ScoredScene

SCENE = Path("results/adt/scene1")

# By name of the run: what it changes. One recording is filmed for all of them, at the size of the largest.
RUNS: Mapping[str, Mapping[str, Any]] = {
    "GPU, 512 px": {},
    "CPU, 512 px": {"run": {"device": "cpu", "backend": "cpu"}},
    "GPU, 1408 px": {"frames": {"resolution": 1408}},
}
RECORDED = {"synthetic": {"size": 1408}}


def variant_of(name: str) -> str:
    """The variant of a run, a name that a file can have."""
    return name.lower().replace(", ", "_").replace(" ", "_")


def write_configuration(folder: Path) -> None:
    """Write a configuration whose variants are ``RUNS``."""
    (folder / "config").mkdir(parents=True, exist_ok=True)
    variants = {variant_of(name): dict(changed) for name, changed in RUNS.items() if changed}
    (folder / "config/config.yaml").write_text(yaml.safe_dump({**RECORDED, "variants": variants}))
    (folder / "config/scenes.tsv").write_text((ROOT / "config/scenes.tsv").read_text())


def metrics_of(name: str) -> Path:
    """The scores of a run, relative to the working folder."""
    own = SCENE / "variants" / variant_of(name) if RUNS[name] else SCENE
    return own / "metrics.json"


def run(folder: Path) -> None:
    """Make the scores of all runs, one job at a time, so that times are those of a machine with nothing else to do.

    Raises:
        UserError: a job failed; Snakemake has said why.
    """
    write_configuration(folder)
    make(folder, [metrics_of(name) for name in RUNS])


def make(folder: Path, targets: Iterable[Path]) -> None:
    """Make targets of a working folder, one job at a time.

    Raises:
        UserError: a job failed; Snakemake has said why.
    """
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "workflow/Snakefile")]
    # All cores for a job, and one job at a time.
    command += ["--cores", str(len(os.sched_getaffinity(0))), "--jobs", "1", "--"]
    done = subprocess.run([*command, *map(str, targets)], cwd=folder, check=False, stdout=sys.stderr)
    if done.returncode:
        raise UserError(
            f"{folder}: the main job failed (exit {done.returncode}); see above, and run the command again"
        )


def report(folder: Path) -> str:
    """The tables of finished runs, in Markdown.

    Raises:
        UserError: scores are missing, or cannot be compared.
    """
    variants = {name: variant_of(name) if changed else None for name, changed in RUNS.items()}
    found = read_scenes([folder / SCENE], variants)
    scenes = {name: scene for name, (scene,) in found.items()}
    return "\n\n".join([costs(scenes), METHOD, score_table(collect("gpu", found))])


def costs(scenes: Mapping[str, ScoredScene]) -> str:
    """A row for each stage: its time on the clock, and the peaks of main and GPU memory, of each run."""
    records = {}
    for name, scene in scenes.items():
        made = (*filter(None, scene.document["artifacts"].values()), scene.document["provenance"])
        records[name] = {record["stage"]: record for record in made}
    header = ["stage"]
    for name in scenes:
        header += [f"{name} [s]", "memory [GiB]", "GPU [GiB]"]
    stages = list(dict.fromkeys(stage for own in records.values() for stage in own))
    rows = [
        [stage, *(cell for own in records.values() for cell in cells_of(own.get(stage)))] for stage in stages
    ]
    total = ["together"]
    for own in records.values():
        total += [f"{sum(record['wall_s'] for record in own.values()):.1f}", "", ""]
    return markdown(header, [*rows, total])


def cells_of(record: Mapping[str, Any] | None) -> list[str]:
    """Time [s], main memory and GPU memory [GiB] of a stage's provenance."""
    if record is None:
        return ["", "", ""]
    gpu = record["peak_gpu_memory_mb"]
    return [
        f"{record['wall_s']:.1f}",
        f"{record['peak_memory_mb'] / 1024:.1f}",
        "" if gpu is None else f"{gpu / 1024:.1f}",
    ]
