"""Every stage that computes on a GPU runs whole on a pretended one, without mixing devices, and rarely waits for it."""

from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import Artifact, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.compute import Compute
from egosplat.gaussians import trainer
from egosplat.instances import geometry
from egosplat.language import stage as language
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.tracker import Tracker
from egosplat.splats import stage as splats
from egosplat.transient import stage as transient
from egosplat_rivals import loop
from tests.support.pretended_gpu import DEVICE, PretendedGpu
from tests.unit.instances.conftest import masks_of_wall
from tests.unit.instances.test_stage import run as merge
from tests.unit.segments.conftest import video_of
from tests.unit.segments.test_tracker import FRAMES, OPTIONS

pytestmark = pytest.mark.slow

CAMERA = {"refine_poses": "off", "compensate_exposure": "off"}
SPLATS = CAMERA | {
    "iterations": 20,
    "max_gaussians": 300,
    "evaluate_every": 20,
    "sh_degree": 1,
    "masking": "none",
}
TRANSIENT = CAMERA | {"iterations": 12, "input_size": 64, "resolution": 32}
LANGUAGE = {"iterations": 12}


@pytest.fixture(autouse=True)
def many_checkpoints(monkeypatch):
    """Each step is saved."""
    monkeypatch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)


# The gradients of the pose and of the gain are copied to the CPU.
CORRECTED = {"refine_poses": "on", "compensate_exposure": "on"}


def counted(gpu: PretendedGpu, monkeypatch: Any, owner: Any, name: str) -> list[Counter[str]]:
    """The waits of each call of ``owner.name``, filled while a stage runs."""
    original, calls = getattr(owner, name), []

    def call(*args: Any, **kwargs: Any) -> Any:
        before = gpu.waits.copy()
        result = original(*args, **kwargs)
        calls.append(gpu.waits - before)
        return result

    monkeypatch.setattr(owner, name, call)
    return calls


def median(calls: list[Counter[str]]) -> float:
    """Median number of waits; prints the places of the last call for a failing test."""
    print("waits:", dict(calls[-1]))
    return float(np.median([call.total() for call in calls]))


def on_gpu(monkeypatch: Any, *modules: ModuleType) -> None:
    for module in modules:
        monkeypatch.setattr(module, "training_device", lambda backend: DEVICE)


def train(folder: Path, name: str = "splats.zarr", **changes: object) -> Artifact:
    kinds = ("masks", "transient", "instances", "features")
    options = splats.SplatsOptions(**SPLATS | changes)
    paths = {f"{kind}_path": folder / f"{kind}.zarr" for kind in kinds}
    splats.run(folder / "frames.zarr", folder / "poses.zarr", folder / name, options, **paths)
    return verify(folder / name, SCHEMAS)


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({}, 2),
        ({"masking": "refined", "language": "joint", "recipe": "paper"}, 2),
        ({"masking": "initial", "evaluate_every": 10, "sh_degree": 3, **CORRECTED}, 4),
    ],
    ids=["default", "joint", "corrected"],
)
def test_splats(scene, gpu, monkeypatch, changes, limit):
    """Mixed devices would end training on a GPU; each wait leaves it idle."""
    folder = scene()
    on_gpu(monkeypatch, splats)
    calls = counted(gpu, monkeypatch, trainer, "iterate")
    result = train(folder, **changes)
    assert len(calls) <= 20 and median(calls) <= limit
    assert np.isfinite(result.read("means")).all() and result.read("curve/loss")[-1] > 0


def test_training_resumes_on_the_device_with_the_result_of_the_cpu(scene, gpu, monkeypatch, capsys):
    """A checkpoint lies on the CPU; a pretended device that computed something else would protect nothing."""

    def killed(*args: object) -> None:
        raise KeyboardInterrupt

    folder = scene()
    before = train(folder, "cpu.zarr", iterations=15)
    assert not gpu.waits
    on_gpu(monkeypatch, splats)
    with monkeypatch.context() as patch:
        patch.setattr(splats, "_put_held_out", killed)
        with pytest.raises(KeyboardInterrupt):
            train(folder, iterations=15)
    calls = counted(gpu, monkeypatch, trainer, "iterate")
    after = train(folder, iterations=15)
    assert after.read("history/psnr")[-1] == pytest.approx(before.read("history/psnr")[-1], abs=0.5)
    assert "training resumes after iteration" in capsys.readouterr().err and len(calls) < 15


def test_mixed_devices_are_found(gpu):
    """The other tests would pass on a device that allows everything."""
    torch.zeros(3, device=DEVICE) + torch.zeros(3)
    assert gpu.mixed == ["elsewhere aten.add.Tensor"]
    gpu.mixed.clear()


def test_transient(scene, gpu, monkeypatch):
    folder = scene()
    on_gpu(monkeypatch, transient)
    calls = counted(gpu, monkeypatch, trainer, "iterate")
    options = transient.TransientOptions(**TRANSIENT)
    transient.run(folder / "frames.zarr", folder / "poses.zarr", folder / "predicted.zarr", options)
    assert len(calls) == 12 and median(calls) <= 3
    assert np.isfinite(verify(folder / "predicted.zarr", {**SCHEMAS}).read("probability")).all()


def test_instances(tmp_path, gpu, monkeypatch):
    """The Gaussians are trained and the things rendered on the device; they are those of the CPU."""
    folder = masks_of_wall(tmp_path)
    before = merge(folder, "cpu.zarr")
    assert not gpu.waits
    on_gpu(monkeypatch, geometry)
    calls = counted(gpu, monkeypatch, trainer, "iterate")
    after = merge(folder)
    assert len(calls) == 20 and median(calls) <= 2
    assert (after.read("labels") == before.read("labels")).mean() > 0.98


@pytest.mark.parametrize("method", ["lifted", "trained", "sparse", "center", "projected", "clustered"])
def test_language(scene, gpu, monkeypatch, method):
    folder = scene()
    train(folder, iterations=10)
    on_gpu(monkeypatch, language)
    calls = counted(gpu, monkeypatch, loop._Training, "iterate")
    options = language.LanguageOptions(**LANGUAGE | {"method": method})
    kinds = ("frames", "poses", "instances", "features", "splats")
    inputs = {f"{kind}_path": folder / f"{kind}.zarr" for kind in kinds}
    language.run(**inputs, output=folder / "language.zarr", options=options)
    if method == "trained":
        assert len(calls) == 12 and median(calls) <= 2
    assert gpu.waits and np.isfinite(verify(folder / "language.zarr", SCHEMAS).read("code")).all()


def test_segments(sam2, gpu, monkeypatch):
    rng = np.random.default_rng(0)
    images = np.repeat(np.repeat(rng.integers(0, 255, (FRAMES, 5, 7, 3), dtype=np.uint8), 8, 1), 8, 2)
    predictor = sam2.video_predictor.to(DEVICE)
    tracker = Tracker(Sam2(predictor, Compute(DEVICE, torch.float32)), video_of(images), OPTIONS)
    calls = counted(gpu, monkeypatch, tracker, "_forwards")
    assert len(tracker.run().labels) == FRAMES
    # A frame with prompts waits for each mask; the last one has none.
    assert calls[-1].total() <= 20, calls[-1]
