"""The benchmark of a GPU: its code runs whole on the pretended one, whose kernels are those for the CPU."""

import json
import os

import pytest
import torch
import yaml
from click.testing import CliRunner

from benchmarks.common import ROOT
from benchmarks.gpu import __main__ as benchmark
from benchmarks.gpu import agreement, main_job, training
from egosplat.errors import UserError
from egosplat.rasterize.api import rasterization
from egosplat.splats import stage as splats
from tests.support.pretended_gpu import DEVICE
from tests.support.warm import run_snakemake

pytestmark = pytest.mark.slow


def test_agreement_is_measured_on_the_device(gpu, monkeypatch):
    monkeypatch.setattr(agreement, "SCENES", {"large": (0.2, 0.5)})
    rows = list(agreement.differences(DEVICE))
    assert len(rows) == 4 and gpu.waits
    for row in rows:
        assert 0 < float(row[2]) < 1e-3 and float(row[4]) < 1e-2, row
    assert "| large |" in agreement.table(DEVICE)


def like_gsplat(packed, **arguments):
    """egosplat's ``rasterization``, which has gsplat's arguments but one, and its results but one."""
    assert packed is False
    image, alpha, meta = rasterization(**arguments)
    return image, alpha, {**meta, "gaussian_ids": None}


def test_both_trainers_run_on_the_device(scene, gpu, monkeypatch):
    for module in (splats, training):
        monkeypatch.setattr(module, "training_device", lambda backend: DEVICE)
    folder = scene()
    frames, poses = folder / "frames.zarr", folder / "poses.zarr"
    small = {"iterations": 30, "evaluate_every": 10, "max_gaussians": 100, "max_points": 60}
    curves = {
        "ours": training.of_stage(frames, poses, folder / "out.zarr", small),
        "theirs": training.of_gsplat(like_gsplat, frames, poses, 30, 10),
    }
    assert gpu.waits
    for curve in curves.values():
        assert len(curve.psnr) == 3 and curve.psnr[-1] > 10 and curve.gaussians > 0
        assert list(curve.seconds) == sorted(curve.seconds) and curve.seconds[0] > 0
    lines = training.table(curves).splitlines()
    assert len(lines) == 4 and "time to" in lines[0]


def test_density_control_of_gsplat_makes_gaussians(scene, monkeypatch):
    """An optimizer that lost its parameters to the strategy would train nothing."""
    import gsplat

    monkeypatch.setattr(
        gsplat,
        "DefaultStrategy",
        lambda: gsplat.strategy.DefaultStrategy(refine_start_iter=5, refine_every=10),
    )
    folder = scene()
    curve = training.of_gsplat(like_gsplat, folder / "frames.zarr", folder / "poses.zarr", 60, 20)
    start = training.of_gsplat(like_gsplat, folder / "frames.zarr", folder / "poses.zarr", 1, 1)
    assert curve.gaussians != start.gaussians
    assert curve.psnr[-1] > start.psnr[-1] + 1


def test_the_time_to_a_psnr_is_that_of_the_first_evaluation_that_reaches_it():
    curve = training.Curve(30, 5, (1.0, 2.0, 3.0), (20.0, 24.0, 23.0))
    assert curve.seconds_to(22.0) == 2.0 and curve.seconds_to(20.0) == 1.0 and curve.seconds_to(25.0) is None
    slow = training.Curve(30, 5, (2.0, 4.0, 6.0), (19.0, 21.0, 22.0))
    table = training.table({"one": curve, "two": slow}).splitlines()
    assert "time to 22.00 dB" in table[0]
    assert table[2].split("|")[-2].strip() == "2" and table[3].split("|")[-2].strip() == "6"


def test_the_main_job_is_asked_for_at_both_sizes_and_on_the_cpu(tmp_path):
    main_job.write_configuration(tmp_path)
    wanted = [str(main_job.metrics_of(name)) for name in main_job.RUNS]
    words = ["--snakefile", str(ROOT / "workflow/Snakefile"), "--cores", "2", "--dry-run", "--quiet", "host"]
    done = run_snakemake([*words, "--", *wanted], tmp_path, os.environ)
    told = done.stdout + done.stderr
    assert done.returncode == 0, told
    counts = dict(
        line.split() for line in told.splitlines() if len(line.split()) == 2 and line.split()[1].isdigit()
    )
    assert counts["synthetic"] == "1" and counts["frames"] == "2"
    assert counts["splats"] == counts["segments"] == counts["metrics"] == "3"
    on_cpu = yaml.safe_load((tmp_path / "config/config.yaml").read_text())["variants"]["cpu_512_px"]
    assert {key: value for section in on_cpu.values() for key, value in section.items()} == {
        "device": "cpu",
        "backend": "cpu",
    }


def test_the_tables_of_the_main_job_have_every_stage(finished, monkeypatch):
    (name, changed), *_ = main_job.RUNS.items()
    monkeypatch.setattr(main_job, "RUNS", {name: changed})
    page = main_job.report(finished.folder)
    rows = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in page.splitlines() if "|" in line}
    assert {"frames", "segments", "instances", "transient", "splats", "metrics", "together", name} < set(rows)
    recorded = json.loads((finished.folder / main_job.metrics_of(name)).read_text())
    cost = recorded["artifacts"]["splats.zarr"]
    seconds, memory, gpu = (cell.strip() for cell in rows["splats"])
    assert float(seconds) == pytest.approx(cost["wall_s"], abs=0.05 + 1e-9)
    assert float(memory) == pytest.approx(cost["peak_memory_mb"] / 1024, abs=0.05 + 1e-9) and gpu == ""
    assert rows[name][0].strip() == str(recorded["scores"]["all"]["count"])


def test_a_failed_job_ends_the_benchmark(tmp_path, monkeypatch):
    monkeypatch.setattr(main_job, "RECORDED", {"synthetic": {"size": "large"}})
    with pytest.raises(UserError, match="main job failed"):
        main_job.run(tmp_path)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_the_command_says_so(tmp_path):
    done = CliRunner().invoke(benchmark.main, [str(tmp_path / "work")])
    assert done.exit_code == 1 and "no CUDA device" in done.output
    assert not (tmp_path / "work").exists()
