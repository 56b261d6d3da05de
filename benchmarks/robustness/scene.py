"""A small finished scene to damage: its folder, its workflow, and its scores without times."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
import yaml

from benchmarks.common import ROOT
from egosplat.artifacts.lineage import check_tree
from egosplat.pipeline import config as configuration
from egosplat.pipeline.dag import inputs_of
from egosplat.pipeline.stages import PIPELINE, STAGES
from egosplat.progress import log

SCENE = Path("results/adt/scene1")
TARGET = SCENE / "metrics.json"

# A configuration with which all stages take minutes, and checkpoints are frequent enough to meet kills.
SMALL = """
synthetic: {size: 176, fps: 2.0, seconds: 6.0, objects: 16}
frames: {resolution: 96, evaluation_frames: 3}
segments: {points_per_side: 8, key_frame_stride: 6}
transient: {iterations: 60, resolution: 48, input_size: 64}
splats: {masking: refined, iterations: 120, max_points: 1000, max_gaussians: 2000}
"""

# Output of each stage in the scene's folder, in an order in which each follows its inputs.
ARTIFACTS = {name: STAGES[name].output for name in PIPELINE}

_LONGEST_WAIT_S = 300.0

# Parts of metrics.json without times.
SCORED = ("origin", "counts", "scores", "queries", "rendering", "frames")


class Scene:
    """A working folder in which the workflow runs.

    Attributes:
        folder: the working folder.
        transcript: file for the output of Snakemake and its stages, by default in ``folder``.
    """

    def __init__(self, folder: Path, transcript: Path | None = None) -> None:
        self.folder = folder
        self.transcript = transcript or folder / "said.txt"

    def prepare(self) -> None:
        """Write the configuration."""
        shutil.copytree(ROOT / "config", self.folder / "config")
        (self.folder / "small.yaml").write_text(SMALL)

    def copy(self, folder: Path, transcript: Path | None = None) -> "Scene":
        """A private copy with its own Snakemake."""
        shutil.rmtree(folder, ignore_errors=True)
        return Scene(Path(shutil.copytree(self.folder, folder, symlinks=True)), transcript)

    def start(self, *arguments: str) -> "subprocess.Popen[str]":
        """Start the main command."""
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "workflow/Snakefile")]
        command += ["--cores", "2", "--configfile", "small.yaml", *arguments, "--", str(TARGET)]
        return subprocess.Popen(
            command,
            cwd=self.folder,
            stdout=self.transcript.open("a"),
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )

    def said(self) -> str:
        """The output of Snakemake and its stages so far."""
        return self.transcript.read_text()

    def run(self) -> int:
        """Run the main command and return its exit status."""
        return self.start().wait()

    def up_to_date(self) -> bool:
        """Whether the same command finds nothing to do."""
        self.transcript.unlink(missing_ok=True)
        return self.start("--dry-run").wait() == 0 and "Nothing to be done" in self.said()

    def stage_process(self, stage: str) -> psutil.Process | None:
        """The running process of a stage in this folder."""
        for process in psutil.process_iter(["cmdline", "cwd"]):
            words = process.info["cmdline"] or []
            if stage.replace("_", "-") in words and process.info["cwd"] == str(self.folder.resolve()):
                return process
        return None

    def seconds(self, stage: str) -> float:
        """Duration of a stage, measured by Snakemake."""
        tables = [path for path in (self.folder / "logs").rglob(f"{stage}.tsv")]
        return float(pd.read_csv(tables[0], sep="\t")["s"].iloc[0]) if tables else 5.0

    def begun(self, stage: str, snakemake: "subprocess.Popen[str]") -> psutil.Process | None:
        """Wait for the process of a stage; None where Snakemake ends without one."""
        end = time.monotonic() + _LONGEST_WAIT_S
        while time.monotonic() < end and snakemake.poll() is None:
            if (process := self.stage_process(stage)) is not None:
                return process
            time.sleep(0.02)
        return None

    def all_sound(self) -> bool:
        """Whether every existing artifact is whole; there may be none."""
        if not any(self.output(stage).exists() for stage in ARTIFACTS if ARTIFACTS[stage].endswith(".zarr")):
            return True
        return not any(check_tree(self.folder / "results", lambda _: None).values())

    def left_over(self) -> list[Path]:
        """Files that were started and neither finished nor removed."""
        hidden = (self.folder / "results").rglob(".*")
        return [path for path in hidden if path.name.endswith((".tmp", ".checkpoint"))]

    def output(self, stage: str) -> Path:
        """Output of a stage."""
        return self.folder / SCENE / ARTIFACTS[stage]

    def lose(self, stage: str) -> None:
        """Remove the output of a stage and everything made from it."""
        lost = {stage}
        for name in ARTIFACTS:
            if name in lost or lost & _made_from(name):
                lost.add(name)
                remove(self.output(name))

    def there(self) -> set[str]:
        """Stages whose output exists."""
        return {stage for stage in ARTIFACTS if self.output(stage).exists()}

    def resumed(self, finished: "Scene") -> dict[str, bool]:
        """Run the main command again: whether it ends well, with the scores of ``finished``, and leaves nothing over."""
        ended = self.run() == 0
        if not ended:
            log(f"{self.folder}: the same command failed\n{self.said()}")
        return {
            "resumed": ended,
            "same scores": ended and self.scores() == finished.scores(),
            "nothing left over": self.all_sound() and not self.left_over(),
        }

    def scores(self) -> dict[str, Any]:
        """The parts of metrics.json without times and provenance."""
        document = json.loads((self.folder / TARGET).read_text())
        return {name: document[name] for name in SCORED}


def finished_scene(folder: Path) -> Scene:
    """A scene in a new folder after a complete run.

    Raises:
        SystemExit: it failed.
    """
    folder.mkdir()
    scene = Scene(folder)
    scene.prepare()
    if scene.run() != 0:
        raise SystemExit(f"the undisturbed run failed:\n{scene.said()}")
    return scene


def _made_from(stage: str) -> set[str]:
    """The stages whose artifacts a stage of the scene reads."""
    if stage == "synthetic":
        return set()
    recording = {"synthetic"} if "recording" in STAGES[stage].inputs else set()
    return recording | set(
        inputs_of(stage, configuration.merge(configuration.defaults(), yaml.safe_load(SMALL)))
    )


def remove(path: Path) -> None:
    """Remove an artifact, a file or a folder."""
    shutil.rmtree(path) if path.is_dir() else path.unlink()
