"""Run the pipeline in a working folder: write its configuration and table of scenes, start Snakemake."""

import os
import subprocess
import sys
from pathlib import Path

import yaml

from benchmarks.growth.design import CENTER, POINTS, SCENES, Point
from egosplat.pipeline.stages import STAGES

ROOT = Path(__file__).resolve().parents[2]
RESULTS = Path("results/growth")


def prepare(folder: Path) -> None:
    """Write configuration and scenes. Each point but the center is a variant, so that unchanged artifacts are shared."""
    (folder / "config").mkdir(parents=True, exist_ok=True)
    variants = {point.name: dict(point.keys) for point in POINTS if point.keys}
    (folder / "config/config.yaml").write_text(yaml.safe_dump({**CENTER, "variants": variants}))
    rows = (f"growth\t{scene}\tadt\t{scene}\t{options}\n" for scene, options in SCENES.items())
    header = "dataset\tscene\tformat\trecording\toptions\n"
    (folder / "config/scenes.tsv").write_text(header + "".join(rows))


def own_folder(folder: Path, point: Point) -> Path:
    """The folder of the artifacts that a point does not share."""
    scene = folder / RESULTS / point.scene
    return scene / "variants" / point.name if point.keys else scene


def recorded_side(point: Point) -> int:
    """Side of the recorded frames [px]."""
    options = dict(option.split("=") for option in SCENES[point.scene].split())
    return int(options.get("synthetic.size", CENTER["synthetic"]["size"]))


def file_of(stage: str) -> str:
    """The name of a stage's output."""
    return STAGES[stage].output


def make(folder: Path, point: Point) -> None:
    """Run the pipeline for a point: one job at a time, on one thread.

    Raises:
        SystemExit: it failed; the message holds the end of its output.
    """
    own = own_folder(folder, point).relative_to(folder)
    targets = [str(own / file_of(stage)) for stage in point.stages]
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "workflow/Snakefile")]
    done = subprocess.run(
        [*command, "--cores", "1", "--quiet", "all", "--", *targets],
        check=False,
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    if done.returncode != 0:
        raise SystemExit(f"{point.name} failed:\n{done.stdout[-3000:]}")
