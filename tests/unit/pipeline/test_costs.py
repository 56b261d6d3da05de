"""Requests to a scheduler suffice, grow with the scene and the attempt, and include a GPU only for stages that use one."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from egosplat.gaussians.training_views import IN_MEMORY
from egosplat.pipeline import costs
from egosplat.pipeline.config import defaults, merge, resolve
from egosplat.pipeline.costs import COSTS, Sizes, cost_of, gpus, memory_mb, minutes, runtime_min
from egosplat.pipeline.dag import inputs_of
from egosplat.pipeline.stages import STAGES as STAGES_BY_NAME
from tests.support.scenes import put

ROOT = Path(__file__).resolve().parents[3]
STAGES = ("segments", "view_features", "features", "transient", "splats", "language", "metrics")

# By stage: memory that laws fitted to measurements asked for [MB], for 120 frames of 512 x 512 with the default
# configuration, and for 3,600 frames of 1408 x 1408 with the preset paper; ``instances`` with CUDA's libraries.
MEASURED_MB = {
    "synthetic": (1900, 4200),
    "frames": (1100, 1200),
    "annotations": (1200, 1300),
    "poses": (1100, 1200),
    "survey": (1000, 1400),
    "segments": (8100, 49_300),
    "instances": (6200, 1700),
    "view_features": (5600, 22_100),
    "features": (1600, 50_700),
    "transient": (5900, 13_100),
    "masks": (900, 1100),
    "splats": (6200, 32_200),
    "language": (5800, 14_700),
    "carries": (5500, 11_800),
    "rests": (6200, 14_300),
    "metrics": (6200, 30_400),
    "contact_sheet": (1300, 2000),
    "instances_sheet": (1300, 2000),
    "carries_sheet": (1300, 2000),
    "crops_sheet": (1300, 2000),
    "splats_sheet": (1300, 2000),
    "transient_sheet": (2400, 8800),
    "language_sheet": (2400, 8800),
    "queries_sheet": (2300, 26_500),
}


def with_keys(section: str, **keys: object) -> dict:
    return merge(defaults(), {section: keys})


def paper() -> dict:
    return resolve({"preset": "paper"}, ROOT / "config/presets")


def scene(folder: Path, frames: int = 12, side: int = 64, views: int = 400, device: object = ()) -> list[str]:
    """Headers of a scene's artifacts."""
    shapes = {"frames": ("rgb", (frames, side, side, 3)), "view_features": ("feature", (views, 512))}
    for artifact, (array, shape) in shapes.items():
        header = folder / f"{artifact}.zarr" / array / "zarr.json"
        header.parent.mkdir(parents=True)
        header.write_text(json.dumps({"shape": shape}))
        facts = {"attributes": {"egosplat": {"facts": {"device_from_camera": device}}}}
        (header.parents[1] / "zarr.json").write_text(json.dumps(facts))
    return [str(folder / f"{artifact}.zarr") for artifact in shapes]


@pytest.mark.parametrize("stage", MEASURED_MB)
def test_memory_is_no_less_than_was_measured(tmp_path, stage):
    """A job that is killed for memory costs a whole run of the stage; one that asks for much more waits longer."""
    default = scene(tmp_path / "default", 120, 512, views=80 * 120 // 4)
    large = scene(tmp_path / "paper", 3600, 1408, views=384 * 3600)
    for config, inputs, least in zip(
        (defaults(), paper()), (default, large), MEASURED_MB[stage], strict=True
    ):
        assert least <= memory_mb(stage, config, inputs, 1) <= 1.4 * least
        assert memory_mb(stage, config, inputs, 1) % 100 == 0
        assert 10 < runtime_min(stage, config, inputs, 1) <= 24 * 60


@pytest.mark.parametrize("stage", MEASURED_MB)
def test_a_job_knows_its_sizes_from_its_own_inputs(tmp_path, stage):
    """What a stage does not read must not be asked of it; a plan would end there."""
    scene(tmp_path)
    inputs = [str(tmp_path / STAGES_BY_NAME[name].output) for name in inputs_of(stage, defaults())]
    made = [path for path in inputs if Path(path).exists() or "frames" in path]
    assert memory_mb(stage, defaults(), made, 1) > 0 and runtime_min(stage, defaults(), made, 1) > 0


def test_each_rule_that_asks_by_the_table_has_a_row():
    rules = "".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    sheets = re.findall(r'^    "(\w+_sheet)": ', rules, re.MULTILINE)
    assert set(MEASURED_MB) == {*re.findall(r'memory\("(\w+)"\)', rules), *sheets}


def test_each_method_and_segmenter_has_a_row_and_each_row_a_stage():
    configs = [defaults(), with_keys("segments", segmenter="classical"), with_keys("poses", method="colmap")]
    configs += [with_keys("segments", prompting="key_frames"), paper(), with_keys("models", set="published")]
    configs += [resolve({"models": {"set": "published"}}, ROOT / "config/presets")]
    configs += [with_keys("models", clip_model="photos")]
    methods = ("trained", "projected", "center", "clustered", "sparse", "granular", "field", "quantized")
    configs += [with_keys("language", method=method) for method in methods]
    used = {id(cost_of(stage, config, Sizes(stage, config))) for stage in MEASURED_MB for config in configs}
    assert used == {id(cost) for cost in COSTS.values()}


@pytest.mark.parametrize("cost", COSTS)
def test_units_of_a_row_are_sizes(cost):
    units = {name for unit in (*COSTS[cost].mb, *COSTS[cost].minutes) for name in unit.split("*") if name}
    assert all(isinstance(getattr(Sizes, unit), property) for unit in units)


def test_a_larger_scene_requests_more(tmp_path):
    small = scene(tmp_path / "small")
    large = scene(tmp_path / "large", frames=1200, side=1024, views=40_000)
    for stage in STAGES:
        wide = with_keys("splats", max_gaussians=1_000_000)
        assert memory_mb(stage, wide, large, 1) > memory_mb(stage, defaults(), small, 1), stage
        assert runtime_min(stage, wide, large, 1) >= runtime_min(stage, defaults(), small, 1), stage


def test_pictures_are_held_in_memory_up_to_a_limit(tmp_path):
    """``StoredRows`` reads other pictures, and other masks, from the disk."""
    assert pytest.approx(2 * IN_MEMORY / 1e6, abs=1) == costs._HELD_MB
    asked = [
        memory_mb("splats", defaults(), scene(tmp_path / str(count), count, 1408), 1)
        for count in (100, 2000, 4000)
    ]
    assert asked[0] < asked[1] == asked[2]


@pytest.mark.parametrize(
    "stage, section, key, more",
    [
        ("splats", "splats", "language", "joint"),
        ("transient", "transient", "max_gaussians", 200_000),
        ("transient", "transient", "resolution", 256),
        ("segments", "models", "sam2_config", "sam2.1_hiera_b+"),
        ("segments", "segments", "max_instances", 2000),
        ("segments", "segments", "prompting", "key_frames"),
        ("view_features", "models", "clip_model", "ViT-B-16"),
        ("metrics", "models", "clip_model", "ViT-B-16"),
        ("synthetic", "synthetic", "size", 1408),
        ("language", "features", "compression", "none"),
        ("language", "language", "method", "granular"),
    ],
)
def test_keys_that_enlarge_a_job_raise_its_memory(tmp_path, stage, section, key, more):
    inputs = scene(tmp_path, 120, 512)[:1]
    assert memory_mb(stage, with_keys(section, **{key: more}), inputs, 1) > memory_mb(
        stage, defaults(), inputs, 1
    )


@pytest.mark.parametrize(
    "stage, section, key, more",
    [
        ("splats", "splats", "iterations", 30_000),
        ("transient", "transient", "iterations", 7000),
        ("segments", "segments", "points_per_side", 64),
        ("segments", "segments", "point_prompts", "depth"),
        ("segments", "models", "sam2_config", "sam2.1_hiera_b+"),
        ("view_features", "models", "clip_model", "ViT-B-16"),
        ("language", "language", "method", "sparse"),
        ("instances", "instances", "iterations", 3000),
        ("synthetic", "synthetic", "seconds", 60.0),
    ],
)
def test_keys_that_lengthen_a_job_raise_its_time(stage, section, key, more):
    config = with_keys(section, **{key: more})
    before = minutes(stage, defaults(), Sizes(stage, defaults(), frames=120))
    assert minutes(stage, config, Sizes(stage, config, frames=120)) > before


def test_masks_that_are_merged_on_the_scenes_gaussians_need_no_training_before():
    still = merge(defaults(), {"segments": {"track_moving": "never"}, "splats": {"masking": "none"}})
    longer = merge(still, {"instances": {"iterations": 3000}})
    expected = [minutes("instances", one, Sizes("instances", one, frames=120)) for one in (still, longer)]
    assert (
        expected[0]
        == expected[1]
        < minutes("instances", defaults(), Sizes("instances", defaults(), frames=120))
    )


def test_a_further_attempt_requests_a_multiple(tmp_path):
    """A job that was killed for memory or time must not request the same again."""
    inputs = scene(tmp_path)
    for request in (memory_mb, runtime_min):
        assert request("splats", defaults(), inputs, 3) == 3 * request("splats", defaults(), inputs, 1)


@pytest.mark.parametrize("stage", ["segments", "view_features"])
def test_a_job_of_a_chunk_requests_what_its_frames_take(tmp_path, stage):
    long, chunk = scene(tmp_path / "long", frames=36_000), scene(tmp_path / "chunk", frames=500)
    for request in (memory_mb, runtime_min):
        assert request(stage, defaults(), long, 1, chunk=True) == request(stage, defaults(), chunk, 1)


def test_a_job_that_gathers_masks_does_not_prompt(tmp_path):
    inputs = scene(tmp_path, frames=3600)
    gathers = runtime_min("segments", defaults(), [*inputs, "segments.1.chunk"], 1)
    assert gathers < runtime_min("segments", defaults(), inputs, 1) / 2


def test_requests_for_poses_depend_on_their_method(tmp_path):
    """A trajectory is read in 270 MiB; COLMAP, also where the recording has none, takes gigabytes."""
    with_trajectory, without = scene(tmp_path / "a", device=[[1.0]]), scene(tmp_path / "b", device=None)
    assert memory_mb("poses", defaults(), with_trajectory, 1) < 1500
    assert memory_mb("poses", defaults(), without, 1) > 4000
    assert memory_mb("poses", with_keys("poses", method="colmap"), with_trajectory, 1) > 4000


def test_the_job_that_reads_a_recording_needs_no_artifact():
    assert memory_mb("frames", defaults(), [], 1) > 0
    large = with_keys("frames", resolution=1408)
    assert runtime_min("frames", large, [], 1) > runtime_min("frames", defaults(), [], 1)


def test_an_input_that_is_not_made_yet_is_named(tmp_path):
    """Snakemake shows <TBD> for a FileNotFoundError whose filename is one of the job's inputs."""
    later = str(tmp_path / "later" / "frames.zarr")
    with pytest.raises(FileNotFoundError) as raised:
        memory_mb("masks", defaults(), [later], 1)
    assert raised.value.filename == later


def test_a_size_that_nothing_tells_is_no_missing_file(tmp_path):
    """A rule without the needed input is an error, not a <TBD>."""
    with pytest.raises(LookupError, match="frames"):
        _ = Sizes("survey", defaults(), [str(tmp_path / "poses.zarr")]).frames


def test_published_models_take_longer_without_a_gpu(tmp_path):
    """With a GPU the assumed speed counts; on processors it would end each job too early."""
    inputs = scene(tmp_path, 120)
    published = {"sam2_config": "sam2.1_hiera_b+"}
    on_gpu = runtime_min("segments", with_keys("models", **published), inputs, 1)
    config = merge(with_keys("models", **published), {"run": {"device": "cpu"}})
    on_cpu = runtime_min("segments", config, inputs, 1)
    assert on_cpu > on_gpu > 10


def test_words_for_photographs_take_what_was_measured(tmp_path):
    """17 pictures of a desk took 112 CPU-s and 1,091 MB on one of two cores."""
    config, inputs = with_keys("models", clip_model="photos"), scene(tmp_path, 17, 384)
    assert 0.5 < minutes("view_features", config, Sizes("view_features", config, inputs)) < 2
    assert memory_mb("view_features", config, inputs, 1) > 1091


@pytest.mark.parametrize("stage", (*STAGES, "frames", "poses", "masks", "queries_sheet"))
def test_a_gpu_is_requested_only_for_stages_that_can_use_one(stage):
    """A GPU that a job cannot use is taken from others."""
    uses = {"segments", "instances", "view_features", "transient", "splats", "language", "metrics"}
    assert gpus(stage, defaults()) == int(stage in uses)


def test_keys_that_keep_a_stage_on_the_cpu_request_no_gpu(tmp_path):
    """Nor memory for CUDA's libraries."""
    assert gpus("splats", with_keys("run", backend="cpu")) == 0
    assert gpus("segments", with_keys("segments", segmenter="classical")) == 0
    assert gpus("instances", with_keys("instances", source="tracks")) == 0
    assert gpus("view_features", with_keys("run", device="cpu")) == 0
    assert gpus("metrics", with_keys("run", device="cpu")) == 1  # it renders as well
    inputs = scene(tmp_path)
    without = memory_mb("splats", with_keys("run", backend="cpu"), inputs, 1)
    assert memory_mb("splats", defaults(), inputs, 1) > without + 3000


def test_the_headers_are_those_of_the_schemas():
    """A renamed or transposed array of an artifact must be renamed here."""
    from egosplat.artifacts.registry import SCHEMAS

    names = {
        "frames": {"frame"},
        "pixels": {"height", "width"},
        "instances": {"instance"},
        "gaussians": {"gaussian"},
        "numbers": {"view", "channel"},
    }
    for size, sources in costs._IN_ARTIFACTS.items():
        for artifact, array, axes in sources:
            dims = SCHEMAS[artifact].fields[array].dims[axes]
            assert set(dims) == names[size] and len(dims) == axes.stop - axes.start, (size, artifact)


def test_the_gaussians_of_another_program_are_counted(tmp_path):
    """Training's limit does not hold for them; before they are read their number is not known."""
    put(tmp_path, "splats", {"means": np.zeros((7000, 3), np.float32)})
    config = merge(defaults(), {"splats": {"source": "scene.ply", "max_gaussians": 10}})
    paths = [str(tmp_path / "splats.zarr")]
    assert Sizes("language", config, paths).gaussians == 0.007
    trained = merge(config, {"splats": {"source": None}})
    assert Sizes("splats", config).gaussians == Sizes("language", trained, paths).gaussians == 1e-5
