"""The finished scene that copies are made of."""

import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

from egosplat.pipeline.stages import STAGES

ROOT = Path(__file__).resolve().parents[2]
TARGETS = ("results/adt/scene1/metrics.json", "results/adt/scene1/survey.json")
LEFT_OUT = shutil.ignore_patterns(".snakemake", "logs", "src", "depth_images*", "__pycache__", "*.log")
"""Of a finished folder: what no try needs."""


def make(folder: Path) -> Path:
    """Run the workflow once, with the tiny settings of the tests."""
    work = folder / "run"
    work.mkdir(parents=True)
    shutil.copytree(ROOT / "config", work / "config")
    (work / "tiny.yaml").write_text(tiny_settings())
    done = run_snakemake(work, "--configfile", "tiny.yaml", "--", *TARGETS)
    if done.returncode != 0:
        raise SystemExit(f"the undisturbed run failed:\n{done.stderr}")
    return Path(shutil.copytree(work, folder / "small", symlinks=True, ignore=LEFT_OUT))


def tiny_settings() -> str:
    """Those of ``tests/conftest.py``, which is no module that can be imported from here."""
    found = re.search(
        r'^TINY = """(.*?)"""', (ROOT / "tests/conftest.py").read_text(), re.DOTALL | re.MULTILINE
    )
    if found is None:
        raise SystemExit("tests/conftest.py has no TINY any more")
    return found[1]


def run_snakemake(
    folder: Path, *words: object, env: dict[str, str] | None = None
) -> "subprocess.CompletedProcess[str]":
    """The workflow, in a folder."""
    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--snakefile",
        ROOT / "workflow/Snakefile",
        "--cores",
        "1",
        *words,
    ]
    return subprocess.run(
        [str(word) for word in command],
        check=False,
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1"} | (env or {}),
        capture_output=True,
        text=True,
        errors="replace",
        timeout=600,
    )


def import_all() -> None:
    """Import what tries use before they are forked off, so that each takes a second and not ten."""
    for name in (
        *(stage.module for stage in STAGES.values()),
        "egosplat.artifacts.registry",
        "egosplat.tables.stage",
        "egosplat.artifacts.check",
        "egosplat.cli",
        "egosplat.doctor.examination",
        "egosplat.language.ply",
        "egosplat.models.open_clip_loader",
        "egosplat.models.video_predictor",
        "egosplat.report.query_command",
        "egosplat.tradeoff.stage",
        "hydra.utils",
        "open_clip",
        "pycolmap",
        "sam2.sam2_video_predictor",
    ):
        import_module(name)
