"""``egosplat run`` on a tiny video with known poses: from an empty folder to a page and answers, then nothing to do."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from egosplat.viewing.html import facts_of
from tests.conftest import ROOT
from tests.support.warm import warm_stages
from tests.unit.frames.conftest import write_video

KEYS = (
    *("segments.segmenter=classical", "frames.resolution=64", "frames.lens=pinhole"),
    *("splats.iterations=20", "splats.max_gaussians=1000", "instances.iterations=20"),
    "view_features.max_views=1",
)


def egosplat_run(folder: Path, *given: str) -> "subprocess.CompletedProcess[str]":
    settings = shlex.join(word for key in KEYS for word in ("--set", key))
    return shell(folder, f"egosplat run {shlex.join(given)} --preset draft --cores 1 {settings}")


def shell(folder: Path, command: str) -> "subprocess.CompletedProcess[str]":
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "PATH": path} | warm_stages()
    words = ["bash", "-c", command]
    return subprocess.run(words, check=False, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.fixture
def clip(tmp_path) -> Path:
    """Eight frames of a colored wall two meters away; the camera moves along it."""
    wall = np.random.default_rng(0).integers(0, 255, (6, 10, 3), np.uint8).repeat(16, 0).repeat(16, 1)
    video = write_video(tmp_path / "wall.mp4", [wall[16:64, 8 * n : 8 * n + 64] for n in range(8)])
    camera = {"w": 64, "h": 48, "fl_x": 64.0, "fl_y": 64.0, "cx": 32.0, "cy": 24.0}
    poses = [[[1, 0, 0, 0.25 * n], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] for n in range(8)]
    frames = [{"file_path": str(n), "transform_matrix": pose} for n, pose in enumerate(poses)]
    (tmp_path / "wall.mp4.transforms.json").write_text(json.dumps(camera | {"frames": frames}))
    return video


@pytest.mark.slow
def test_a_video_becomes_a_scene_that_answers(clip, tmp_path):
    (folder := tmp_path / "empty").mkdir()
    done = egosplat_run(folder, str(clip), "--words", "couch", "wooden door")
    assert done.returncode == 0, done.stdout + done.stderr
    rules = set(re.findall(r"\(Rule: (\w+)\)", done.stderr))
    assert {"frames", "poses", "splats", "language", "scene_page"} <= rules
    assert re.search(r"^couch +\S", done.stdout, re.MULTILINE) and "wooden door" in done.stdout
    page = (folder / "results/mine/wall/scene.html").read_text()
    names = shlex.join(thing["phrase"] for thing in facts_of(page)["catalog"][:3])
    suggested = f"query results/mine/wall {names} " if names else "catalog results/mine/wall\n"
    assert f"  egosplat {suggested}" in done.stderr
    sheets = next(line for line in done.stderr.splitlines() if "story.html" in line).partition("    ")[0]
    assert shell(folder, sheets).returncode == 0 and (folder / "results/mine/wall/crops.png").is_file()
    assert {path.name for path in folder.iterdir()} == {"config", "logs", "results", ".snakemake"}
    log = (folder / "logs/mine/wall/splats.log").read_text()
    assert all(line.startswith("splats: ") for line in log.splitlines())

    again = egosplat_run(folder, str(clip))
    assert again.returncode == 0 and "Nothing to be done" in again.stderr

    # What a message tells to remove comes back, with the same settings.
    splats, told = "results/mine/wall/splats.zarr", "egosplat view results/mine/wall 2>&1"
    lost = f"{splats} results/mine/wall/features.zarr"
    made = shell(folder, f'rm -r {lost}; eval "$({told} | sed "s/.*Make the scene: //")"; rm -r {splats}')
    assert made.returncode == 0 and "splats: took 0:" in made.stdout
    assert set(re.findall(r"\(Rule: (\w+)\)", made.stderr)) == {"splats", "features"}, made.stderr
    assert egosplat_run(folder, str(clip)).returncode == 0 and (folder / splats).is_dir()

    clip.with_name("wall.mp4.transforms.json").write_text("{}")
    failed = egosplat_run(folder, str(clip))
    assert failed.returncode == 2 and "wall.mp4.transforms.json" in failed.stderr
    assert "logs/mine/wall/" in failed.stderr
