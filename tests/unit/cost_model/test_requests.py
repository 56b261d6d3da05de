"""Requests to a scheduler suffice, grow with the attempt, and include a GPU only for stages that use one."""

from pathlib import Path

import pytest
import zarr

from egosplat.cost_model.laws import law_of, memory_mib
from egosplat.cost_model.requests import gpus, memory_mb, runtime_min
from egosplat.cost_model.sizes import Sizes
from egosplat.pipeline.config import defaults, merge, resolve

ROOT = Path(__file__).resolve().parents[3]
STAGES = ("segments", "view_features", "features", "transient", "splats", "language", "metrics")


def with_keys(section: str, **keys: object) -> dict:
    return merge(defaults(), {section: keys})


def scene(
    folder: Path, frames: int = 12, side: int = 64, gaussians: int = 1000, device: object = None
) -> list[str]:
    """Artifacts of a scene of this size, without values."""
    arrays = {
        "frames/rgb": (frames, side, side, 3),
        "segments/instances/level": (60,),
        "view_features/feature": (30 * frames, 512),
        "features/code": (60, 16),
        "splats/means": (gaussians, 3),
    }
    for path, shape in arrays.items():
        artifact, _, name = path.partition("/")
        group = zarr.open_group(folder / f"{artifact}.zarr", mode="a")
        group.create_array(name, shape=shape, dtype="u1")
        group.attrs["egosplat"] = {"facts": {"device_from_camera": device}}
    return [
        str(folder / f"{artifact}.zarr")
        for artifact in dict.fromkeys(path.partition("/")[0] for path in arrays)
    ]


def test_memory_holds_the_expected_peak_and_a_margin(tmp_path):
    """A job that is killed for memory costs a whole run of the stage."""
    inputs, config = scene(tmp_path), defaults()
    for stage in STAGES:
        expected = memory_mib(law_of(stage, config), Sizes(config, inputs)) * 2**20 / 1e6
        assert memory_mb(stage, config, inputs, 1) > 1.3 * expected
        assert memory_mb(stage, config, inputs, 1) % 100 == 0


def test_a_larger_scene_requests_more(tmp_path):
    """Requests follow the inputs' headers."""
    small = scene(tmp_path / "small")
    large = scene(tmp_path / "large", frames=1200, side=1024, gaussians=1_000_000)
    for stage in STAGES:
        assert memory_mb(stage, defaults(), large, 1) > memory_mb(stage, defaults(), small, 1), stage
        # A linear basis takes seconds in any scene.
        if stage != "features":
            assert runtime_min(stage, defaults(), large, 1) > runtime_min(stage, defaults(), small, 1), stage


def test_a_method_that_trains_requests_its_own_time(tmp_path):
    """A variant's job asks with the keys of the variant, and each method takes its own time."""
    inputs = scene(tmp_path)
    own, networks, words = (
        runtime_min("language", with_keys("language", method=method), inputs, 1)
        for method in ("lifted", "granular", "sparse")
    )
    assert networks > words > own


def test_a_further_attempt_requests_a_multiple(tmp_path):
    """A job that was killed for memory or time must not request the same again."""
    inputs = scene(tmp_path)
    assert memory_mb("splats", defaults(), inputs, 3) == 3 * memory_mb("splats", defaults(), inputs, 1)
    assert runtime_min("splats", defaults(), inputs, 3) == 3 * runtime_min("splats", defaults(), inputs, 1)


def test_requests_for_poses_depend_on_their_method(tmp_path):
    """A trajectory is read in 270 MiB; COLMAP takes gigabytes."""
    read = memory_mb("poses", defaults(), scene(tmp_path / "a", device=[[1.0]]), 1)
    found = memory_mb("poses", defaults(), scene(tmp_path / "b"), 1)
    assert read < 1500 and found > 4000


def test_the_job_that_reads_a_recording_needs_no_artifact():
    """The length of a recording is unknown before it is read."""
    for stage in ("synthetic", "frames"):
        assert memory_mb(stage, defaults(), [], 1) < 3000
        assert 10 <= runtime_min(stage, defaults(), [], 1) < 60
    assert runtime_min("frames", with_keys("frames", resolution=1408), [], 1) > runtime_min(
        "frames", defaults(), [], 1
    )


def test_the_papers_sizes_fit_a_node_and_a_day(tmp_path):
    """The preset paper on 1,800 frames of 1408 x 1408: below 64 GB, and a day at most."""
    paper = resolve({"preset": "paper"}, ROOT / "config/presets")
    inputs = scene(tmp_path, frames=1800, side=1408, gaussians=5_000_000, device=[[1.0]])
    for stage in (*STAGES, "frames", "poses", "annotations", "masks"):
        assert memory_mb(stage, paper, inputs, 1) < 64_000, stage
        assert 10 <= runtime_min(stage, paper, inputs, 1) <= 24 * 60, stage
    frames_mb = 1800 * 1408**2 * 3 / 1e6
    assert memory_mb("splats", paper, inputs, 1) > frames_mb


def test_published_models_take_longer_without_a_gpu(tmp_path):
    """With a GPU the assumed speed counts; on processors it would end each job too early."""
    inputs = scene(tmp_path)
    published = {"sam2_config": "sam2.1_hiera_b+"}
    on_gpu = runtime_min("segments", with_keys("models", **published), inputs, 1)
    on_cpu = runtime_min(
        "segments",
        with_keys("models", **published) | {"run": defaults()["run"] | {"device": "cpu"}},
        inputs,
        1,
    )
    assert on_cpu > on_gpu > runtime_min("segments", defaults(), inputs, 1)


@pytest.mark.parametrize("stage", (*STAGES, "frames", "poses", "masks", "queries_sheet"))
def test_a_gpu_is_requested_only_for_stages_that_can_use_one(stage):
    """A GPU that a job cannot use is taken from others."""
    uses = {"segments", "view_features", "transient", "splats", "language", "metrics"}
    assert gpus(stage, defaults()) == int(stage in uses)


def test_keys_that_keep_a_stage_on_the_cpu_request_no_gpu(tmp_path):
    """Nor for the memory of CUDA's libraries."""
    assert gpus("splats", with_keys("run", backend="cpu")) == 0
    assert gpus("segments", with_keys("segments", segmenter="classical")) == 0
    assert gpus("view_features", with_keys("run", device="cpu")) == 0
    assert gpus("metrics", with_keys("run", device="cpu")) == 1  # it renders as well
    inputs = scene(tmp_path)
    without = memory_mb("splats", with_keys("run", backend="cpu"), inputs, 1)
    assert memory_mb("splats", defaults(), inputs, 1) > without
