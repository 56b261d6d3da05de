"""The laws of memory and time grow with a scene and follow the configuration."""

import json
import re
from pathlib import Path

import pytest

from egosplat.cost_model.expected import expected_seconds
from egosplat.cost_model.laws import CPU, HELD_MIB, evaluate, law_of, laws, memory_mib, seconds
from egosplat.cost_model.sizes import Sizes
from egosplat.gaussians.stored_rows import IN_MEMORY
from egosplat.pipeline.config import defaults, merge, section_keys

ROOT = Path(__file__).resolve().parents[3]
SCENE = {
    "frames": 120,
    "pixels": 512**2,
    "instances": 72,
    "views": 4000,
    "channels": 512,
    "gaussians": 100_000,
}
GROWING = {
    (): "synthetic",
    ("frames",): "poses",
    ("pixels",): "frames annotations survey masks contact_sheet instances_sheet crops_sheet splats_sheet",
    ("gaussians",): "transient_sheet language_sheet",
    ("pixels", "gaussians"): "metrics queries_sheet",
    ("pixels", "views", "gaussians", "channels"): "language",
    ("pixels", "views", "channels"): "view_features",
    ("views", "channels"): "features",
    ("frames", "pixels"): "segments instances transient",
    ("frames", "pixels", "gaussians"): "splats",
}
MEMORY_GROWS_WITH = {stage: sizes for sizes, stages in GROWING.items() for stage in stages.split()}
"""The sizes that the memory of each stage grows with."""


def with_keys(section: str, **keys: object) -> dict:
    return merge(defaults(), {section: keys})


def memory(stage: str, config: dict | None = None, **sizes: float) -> float:
    config = config or defaults()
    return memory_mib(law_of(stage, config), Sizes(config, given=SCENE | sizes))


def time(stage: str, config: dict | None = None, **sizes: float) -> float:
    config = config or defaults()
    return seconds(law_of(stage, config), Sizes(config, given=SCENE | sizes))


def test_every_rule_that_asks_for_memory_by_a_law_has_one():
    """No job fails for a law that is missing, and no law here is of a stage that no rule runs."""
    rules = "".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    assert set(MEMORY_GROWS_WITH) == set(re.findall(r'memory\("(\w+)"\)', rules))
    assert {law_of(stage, defaults()) for stage in MEMORY_GROWS_WITH} <= set(laws())


@pytest.mark.parametrize("stage", MEMORY_GROWS_WITH)
def test_memory_grows_with_the_sizes_that_a_stage_holds(stage):
    """A larger size raises the memory of exactly the stages that hold such data."""
    grows = {name for name, size in SCENE.items() if memory(stage, **{name: 2 * size}) > memory(stage)}
    assert grows == set(MEMORY_GROWS_WITH[stage])


@pytest.mark.parametrize("stage", MEMORY_GROWS_WITH)
def test_no_size_makes_a_stage_cheaper(stage):
    """Every law is monotone in every size. More frames show the same instances more often."""
    for name, size in SCENE.items():
        more = {name: 2 * size} | ({"views": 2 * SCENE["views"]} if name == "frames" else {})
        assert memory(stage, **more) >= memory(stage)
        assert time(stage, **more) >= time(stage)


@pytest.mark.parametrize(
    "stage, section, key, more",
    [
        ("splats", "splats", "language", "joint"),
        ("transient", "transient", "max_gaussians", 200_000),
        ("transient", "transient", "resolution", 256),
        ("segments", "models", "sam2_config", "sam2.1_hiera_b+"),
        ("view_features", "models", "clip_model", "ViT-B-16"),
        ("metrics", "models", "clip_model", "ViT-B-16"),
        ("synthetic", "synthetic", "size", 1408),
        ("language", "features", "dims", 256),
        ("language", "features", "compression", "none"),
        ("language", "language", "method", "clustered"),
        ("segments", "segments", "prompting", "key_frames"),
    ],
)
def test_keys_that_enlarge_a_job_raise_its_memory(stage, section, key, more):
    """The configuration's own sizes and models are part of the cost."""
    assert memory(stage, with_keys(section, **{key: more})) > memory(stage)


@pytest.mark.parametrize(
    "stage, section, key, more",
    [
        ("splats", "splats", "iterations", 30_000),
        ("transient", "transient", "iterations", 7000),
        ("segments", "segments", "image_size", 640),
        ("segments", "segments", "points_per_side", 64),
        ("segments", "models", "sam2_config", "sam2.1_hiera_b+"),
        ("view_features", "models", "clip_model", "ViT-B-16"),
        ("language", "language", "method", "trained"),
        ("instances", "instances", "iterations", 3000),
        ("synthetic", "synthetic", "seconds", 60.0),
    ],
)
def test_keys_that_lengthen_a_job_raise_its_time(stage, section, key, more):
    """As for memory."""
    assert time(stage, with_keys(section, **{key: more})) > time(stage)


def test_a_camera_that_is_not_corrected_shortens_training():
    """As long as the survey has not decided, the longer time is expected, but for a synthetic ideal camera."""
    off, on = (
        time("splats", with_keys("camera", refine_poses=value, compensate_exposure=value))
        for value in ("off", "on")
    )
    assert off < on == time("splats")
    ideal, real = (
        expected_seconds("splats", with_keys("synthetic", camera=camera), synthetic=True)
        for camera in ("ideal", "real")
    )
    assert ideal < real


def test_training_time_is_proportional_to_its_iterations():
    """A known point: start-up apart, twice the iterations take twice the time."""
    once, twice = (time("splats", with_keys("splats", iterations=n)) for n in (10_000, 20_000))
    more = time("splats", with_keys("splats", iterations=30_000))
    assert more - twice == pytest.approx(twice - once)


def test_a_trajectory_takes_less_than_colmap():
    """Poses that are read from a file must not request COLMAP's memory and time."""
    sizes = Sizes(defaults(), given=SCENE)
    read, found = law_of("poses", defaults()), law_of("poses", defaults(), colmap=True)
    assert memory_mib(read, sizes) < memory_mib(found, sizes) / 5
    assert seconds(read, sizes) < seconds(found, sizes) / 5


def test_the_time_of_sam2_grows_with_the_area_of_its_input():
    """segments.image_size doubled: four times the time of tracking, where frames are not segmented by themselves."""
    law = {term: factor for term, factor in laws()["segments"]["cpu_s"].items() if "sam2_area" in term}
    assert law
    keys = {"prompting": "key_frames"}
    areas = [Sizes(with_keys("segments", image_size=side, **keys))["sam2_area"] for side in (320, 640)]
    assert areas == [1.0, 4.0]


def test_a_frame_counts_as_many_prompts_as_it_has_pixels_and_crops():
    """Masks of single frames: tracks keep SAM2's own size, whole frames have the image size, and four crops come on top."""
    sizes = Sizes(with_keys("segments", image_size=640, crops_per_side=2), given=SCENE)
    alone = Sizes(with_keys("segments", image_size=320, crops_per_side=1), given=SCENE)
    assert sizes["sam2_area"] == 1.0
    assert sizes["prompts"] / alone["prompts"] == pytest.approx(4 + 4)


def test_slower_kernels_take_longer_only_where_gaussians_are_rendered():
    """A processor without AVX-512 slows the rasterizer down, not SAM2."""
    sizes = Sizes(defaults(), given=SCENE)
    assert seconds("splats", sizes, "generic") > seconds("splats", sizes, "avx2") > seconds("splats", sizes)
    assert seconds("segments", sizes, "generic") == seconds("segments", sizes)


def held_out() -> list[dict]:
    """The runs of the finished scene of 512 px that no law was fitted to. Another one has larger pictures than any in the fit."""
    checks = json.loads((ROOT / "benchmarks/growth/growth.json").read_text())["checks"].values()
    (runs,) = [runs for runs in checks if runs[0]["sizes"]["pixels"] == 512**2]
    return runs


def test_laws_predict_the_scene_that_they_were_not_fitted_to():
    """The shipped table agrees with a finished scene."""
    measured = held_out()
    assert len(measured) == 13
    for run in measured:
        law, sizes = law_of(run["stage"], defaults()), run["sizes"]
        # A request has a margin of 1.3.
        assert 0.9 < memory_mib(law, sizes) / run["peak_memory_mb"] < 1.15, run["stage"]
        if run["cpu_s"] > 5:
            assert 0.7 < evaluate(laws()[law][CPU], sizes) / run["cpu_s"] < 1.4, run["stage"]


def test_sizes_that_are_not_known_yet_are_those_of_a_furnished_apartment():
    """What doctor and the first line of a run say: within a factor of two of a scene that no law was fitted to."""
    known = {"frames": 120, "pixels": 512**2, "recorded_pixels": 704**2}
    for run in held_out():
        if run["cpu_s"] > 5:
            law = laws()[law_of(run["stage"], defaults())][CPU]
            ratio = evaluate(law, Sizes(defaults(), given=known)) / run["cpu_s"]
            assert 0.5 < ratio < 2, (run["stage"], ratio)


@pytest.mark.parametrize("method", section_keys("language")["method"]["enum"])
def test_every_way_to_give_codes_has_a_law(method):
    """Of memory and time, for codes of a scene; jointly trained codes are none of them."""
    own, joint = with_keys("language", method=method), with_keys("splats", language="joint")
    assert time("language", own) > 0 and memory("language", own) > 0
    assert (law_of("language", own) == law_of("language", defaults())) == (method == "lifted")
    assert law_of("language", merge(own, joint)) == "language"


LONG = {"frames": 3600, "training": 3564, "pixels": 1408**2, "gaussians": 20_000, "initial_gaussians": 20_000}
"""Sizes of benchmarks/long_recording."""


@pytest.mark.parametrize(
    "stage, section, measured_gib",
    [("splats", {"masking": "refined"}, 4.7), ("transient", {"resolution": 1408}, 3.6)],
)
def test_laws_predict_a_long_recording_of_large_pictures(stage, section, measured_gib):
    """What benchmarks/long_recording measured, which is far outside of the fit; the margin of a request covers a tenth."""
    expected = memory_mib(stage, Sizes(with_keys(stage, **section), given=LONG)) / 1024
    assert 0.9 * measured_gib < expected < 1.3 * measured_gib


def test_no_more_pictures_and_masks_are_in_memory_than_training_holds():
    """Beyond that they are read from the artifact, and memory grows no more."""
    assert HELD_MIB * 2**20 == IN_MEMORY
    masked, unmasked = (with_keys("splats", masking=kind) for kind in ("refined", "none"))
    few, many = ({**LONG, "training": count} for count in (50, 40_000))
    assert memory_mib("splats", Sizes(masked, given=few)) < memory_mib("splats", Sizes(masked, given=LONG))
    assert memory_mib("splats", Sizes(masked, given=LONG)) == memory_mib("splats", Sizes(masked, given=many))
    held = memory_mib("splats", Sizes(masked, given=LONG)) - memory_mib("splats", Sizes(unmasked, given=LONG))
    assert held == pytest.approx(HELD_MIB)
