"""What jobs request."""

import json

import pytest

from egosplat.pipeline import costs
from egosplat.pipeline.config import defaults, merge
from egosplat.pipeline.stages import STAGES

CONFIG = defaults()


@pytest.fixture
def frames(tmp_path):
    """frames.zarr of 1,000 frames of 1000 x 1000 px: one gigapixel."""
    header = tmp_path / "frames.zarr" / "rgb" / "zarr.json"
    header.parent.mkdir(parents=True)
    header.write_text(json.dumps({"shape": [1000, 1000, 1000, 3]}))
    return str(header.parents[1])


def test_memory_and_time_grow_with_the_pixels_and_the_attempt(frames):
    base, slope, *time = STAGES["masks"].request
    grown = base + -(-slope // 100) * 100
    assert costs.request("masks", CONFIG, [], 1)["mem_mb"] == base
    assert costs.request("masks", CONFIG, [frames], 1)["mem_mb"] == grown
    assert costs.request("masks", CONFIG, [frames], 2)["mem_mb"] == 2 * grown
    assert costs.request("masks", CONFIG, [frames], 1)["runtime"] == sum(time)


def test_a_chunk_has_its_own_frames_and_a_recording_to_come_counts_as_it_is_filmed_or_read(frames):
    assert costs.gigapixels("segments", CONFIG, [frames], chunk=True) == 0.5
    film = CONFIG["synthetic"]
    filmed = film["seconds"] * film["fps"] * film["size"] ** 2 / 1e9
    assert costs.gigapixels("synthetic", CONFIG, []) == filmed
    assert costs.gigapixels("frames", CONFIG, []) == 3600 * CONFIG["frames"]["resolution"] ** 2 / 1e9


def test_an_input_that_is_still_to_be_made_is_named(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        costs.request("masks", CONFIG, [str(tmp_path / "frames.zarr")], 1)
    assert error.value.filename == str(tmp_path / "frames.zarr")


def test_no_job_asks_for_more_than_a_day_at_once(frames):
    published = merge(CONFIG, {"models": {"sam2_config": "sam2.1_hiera_b+"}, "run": {"device": "cpu"}})
    assert costs.request("segments", published, [frames], 1)["runtime"] == 1440
    assert costs.request("segments", published, [frames], 2)["runtime"] == 2880


@pytest.mark.parametrize(
    "stage, change, expected",
    [
        ("splats", {}, 1),
        ("splats", {"run": {"backend": "cpu"}}, 0),
        ("segments", {"segments": {"segmenter": "classical"}}, 0),
        ("instances", {"instances": {"source": "tracks"}}, 0),
        ("masks", {}, 0),
    ],
)
def test_a_job_asks_for_a_gpu_if_it_can_use_one(stage, change, expected):
    assert costs.gpus(stage, merge(CONFIG, change)) == expected


def test_a_stage_that_needs_more_than_the_machine_has_for_its_frames_says_so(frames, monkeypatch):
    """Not where models alone need more, which no frame less would change."""
    base, slope, *_ = STAGES["masks"].request
    for megabytes, told in ((base / 2, False), (base + slope / 2, True), (base + slope, False)):
        monkeypatch.setattr(costs.os, "sysconf", {"SC_PAGE_SIZE": 1e6, "SC_PHYS_PAGES": megabytes}.get)
        assert ("frames.stride" in str(costs.lack_of_memory("masks", {}, frames))) == told
    assert costs.lack_of_memory("masks", {}, frames + "/missing/frames.zarr") is None
