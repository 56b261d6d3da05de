"""The main job through the cluster profile, on a SLURM of our own: the same scores, every job where it belongs."""

import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from benchmarks.robustness.scene import remove
from egosplat.artifacts.lineage import check_tree
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import TILES as TILES_SCHEMA
from egosplat_rivals import tiles_stage
from egosplat_rivals.options import TilesOptions
from tests.support import ROOT
from tests.support.local_slurm import UNDER_WAY
from tests.support.waiting import wait_for
from tests.support.warm import on_cluster, run_snakemake

pytestmark = pytest.mark.slow

SCENE = Path("results/adt/scene1")
METRICS = str(SCENE / "metrics.json")
FRAMES = "results/mine/scene/frames.zarr"
PROFILE = ROOT / "workflow/profiles/slurm"
COSTS = {"created", "wall_s", "cpu_s", "peak_memory_mb", "training_s", "disk_mb"}
"""Keys of provenance that differ between equal runs."""

HERE = (
    *("--slurm-no-account", "--slurm-status-command", "squeue"),
    *("--slurm-init-seconds-before-status-checks", "2", "--slurm-keep-successful-logs"),
    *("--latency-wait", "5"),
)
"""Options for a SLURM without accounting and with short waits."""


@pytest.fixture
def submit(slurm, monkeypatch):
    """Runs Snakemake in a working directory so that it submits to SLURM: what it said, and SLURM's jobs.
    ``measured``: a job is a process of SLURM's own, whose memory SLURM sees."""
    for name, value in slurm.environment.items():
        monkeypatch.setenv(name, value)
    before = set(slurm.states())

    def run(workdir, *arguments: str, measured: bool = False):
        words = workdir.options("--profile", PROFILE, *HERE, *arguments)
        done = run_snakemake(words, workdir.folder, workdir.environment | on_cluster(steps=not measured))
        return done, sorted(set(slurm.states()) - before, key=int)

    return run


# First what waits for SLURM alone, while another process makes the finished run that the last test needs.


@pytest.fixture
def photographs(one_scene, tmp_path):
    """A working directory of four photographs with its own code: ``photographs(lines)`` are added to stage ``frames``."""

    def make(lines: str):
        pictures = tmp_path / "pictures"
        pictures.mkdir()
        for number in range(4):
            Image.new("RGB", (64, 48), (number, 0, 0)).save(pictures / f"{number}.png")
        workdir = one_scene("plain", pictures, "frames.resolution=64 frames.evaluation_frames=1")
        workdir.code = workdir.folder / "src"
        shutil.copytree(ROOT / "src/egosplat", workdir.code / "egosplat")
        shutil.copytree(ROOT / "config/presets", workdir.folder / "config/presets")
        before = "    annotated = is_annotated(format, recording_path)\n"
        workdir.edit("frames/stage.py", before, lines + before)
        return workdir

    return make


@pytest.fixture
def greedy(photographs):
    """One whose stage ``frames`` takes 2 GB, more than it should, for long enough to be seen."""
    return photographs(
        "    import time\n    taken = b'1' * 2_000_000_000\n    time.sleep(3)\n    del taken\n"
    )


def test_a_job_that_is_killed_for_memory_is_submitted_again_with_more(slurm, submit, greedy):
    done, jobs = submit(greedy, "--", FRAMES, measured=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert list(map(slurm.end_of, jobs)) == ["FAILED", "COMPLETED"]
    first, second = [int(slurm.asked_of(job)["MinMemoryNode"].rstrip("M")) for job in jobs]
    assert second == 2 * first


def test_a_job_without_enough_memory_reports_it_and_leaves_nothing(slurm, submit, greedy):
    done, jobs = submit(greedy, "--retries", "0", "--", FRAMES, measured=True)
    told = done.stdout + done.stderr
    assert done.returncode == 1, told
    assert list(map(slurm.end_of, jobs)) == ["FAILED"], told
    assert "exceeded memory limit" in told, told
    assert not (greedy.folder / FRAMES).exists()


def test_a_killed_snakemake_leaves_its_jobs_alone_and_then_goes_on(slurm, submit, photographs, tmp_path):
    """Jobs continue after Snakemake is killed; a second Snakemake must not submit them again."""
    workdir = photographs("    import time\n    time.sleep(5)\n")
    words = ("--profile", PROFILE, *HERE, "--", FRAMES)
    snakemake = workdir.start(*words, transcript=tmp_path / "said.txt")
    before = set(slurm.states())
    (job,) = wait_for(lambda: [new for new in slurm.states() if new not in before])
    wait_for(lambda: slurm.states()[job] == "RUNNING")
    snakemake.kill()
    snakemake.wait()

    done, jobs = submit(workdir, "--", FRAMES)
    assert done.returncode != 0 and "Directory cannot be locked" in done.stdout + done.stderr
    assert jobs == [job]
    assert slurm.end_of(job) == "COMPLETED"
    assert not any(check_tree(workdir.folder / "results", lambda _: None).values())

    assert workdir.snakemake(*words[:2], "--unlock").returncode == 0
    done, _ = submit(workdir, "--", FRAMES)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not any(check_tree(workdir.folder / "results", lambda _: None).values())


def without_costs(values: Any) -> Any:
    if isinstance(values, dict):
        return {key: without_costs(value) for key, value in values.items() if key not in COSTS}
    return [without_costs(value) for value in values] if isinstance(values, list) else values


def scores(folder: Path) -> Any:
    """The content of metrics.json without costs."""
    found = json.loads((folder / METRICS).read_text())
    return without_costs(
        {name: found[name] for name in ("scores", "queries", "frames", "rendering", "counts")}
    )


def rules_of(slurm, jobs: list[str]) -> list[str]:
    """The rule, or the group of rules, that each job of SLURM was submitted for."""
    comments = dict(
        line.split()
        for line in slurm.ask("squeue", "--states=all", "--noheader", "--format=%i %k").splitlines()
    )
    return [re.sub("^(rule|group)_|_wildcards_.*", "", comments[job]) for job in jobs]


def test_the_main_job_runs_on_the_cluster_to_the_same_scores(slurm, submit, finished, workdir):
    folder = workdir.folder
    for made in ("logs", ".snakemake", *(path.relative_to(folder) for path in (folder / SCENE).iterdir())):
        if made != SCENE / "recording":
            remove(folder / made)
    done, jobs = submit(workdir, "--", METRICS)
    told = done.stdout + done.stderr
    assert done.returncode == 0, told

    assert "localrule" not in told
    assert set(map(slurm.end_of, jobs)) == {"COMPLETED"}
    submitted = rules_of(slurm, jobs)
    assert len(jobs) == len(set(submitted)) == told.count("has been submitted with SLURM jobid")
    ran = {path.stem for path in (folder / "logs").rglob("*.log")}
    group = next(name for name in submitted if name.startswith("reading_"))
    assert ran == {*submitted, "frames", "annotations"} - {group}
    assert {"segments", "transient", "splats", "language", "metrics"} < ran
    by_rule = dict(zip(rules_of(slurm, jobs), map(slurm.asked_of, jobs), strict=True))
    assert by_rule["splats"]["TresPerJob"] == "gres:gpu:1" and "TresPerJob" not in by_rule["poses"]
    assert scores(folder) == scores(finished.folder)
    assert not any(check_tree(folder / "results", lambda _: None).values())


TILES = SCENE / "tiles.zarr"
WAITS = """        import time
        if chunk == 2 and not Path("lost").exists():
            while len([*output.parent.glob("tiles.*.chunk")]) < 2:
                time.sleep(0.1)
            Path("waits").write_text(os.environ["SLURM_JOB_ID"])
            time.sleep(600)
"""
"""The job of the second chunk waits for the others to end, and then for its node to be lost."""


def test_a_lost_node_loses_its_own_chunk_alone(slurm, submit, workdir):
    """The last test: the node does not come back."""
    folder = workdir.folder
    tiny = (folder / "tiny.yaml").read_text()
    (folder / "tiny.yaml").write_text(tiny.replace("masking: refined", "masking: auto"))
    workdir.edit("pipeline/chunks.py", "CHUNK_FRAMES = 500", "CHUNK_FRAMES = 4")
    workdir.edit(
        "egosplat_rivals/tiles_stage.py", "        for row in rows:\n", WAITS + "        for row in rows:\n"
    )
    workdir.edit("egosplat_rivals/tiles_stage.py", "\nfrom pathlib", "\nimport os\nfrom pathlib")
    with ThreadPoolExecutor() as pool:
        run = pool.submit(submit, workdir, "--", str(TILES))
        lost = wait_for(lambda: (folder / "waits").exists() and (folder / "waits").read_text())
        wait_for(lambda: [job for job, state in slurm.states().items() if state in UNDER_WAY] == [lost])
        (folder / "lost").touch()
        slurm.lose(slurm.asked_of(lost)["NodeList"])
        done, jobs = run.result()
    assert done.returncode == 0, done.stdout + done.stderr
    assert sorted(rules_of(slurm, jobs)) == ["survey", "tiles", *3 * ["tiles_chunk"]]
    assert set(map(slurm.end_of, jobs)) == {"COMPLETED"}
    assert [job for job in jobs if slurm.asked_of(job)["Restarts"] != "0"] == [lost]
    made = open_artifact(folder / TILES, TILES_SCHEMA)
    tiles_stage.run(
        folder / SCENE / "frames.zarr", folder / "whole.zarr", TilesOptions(**made.provenance["options"])
    )
    assert made.digest == open_artifact(folder / "whole.zarr", TILES_SCHEMA).digest
    assert not [*(folder / SCENE).glob("*.chunk")]
