"""Input of Snakemake: numbers on its command line are numbers, and an error message comes last."""

import json

import pytest
from PIL import Image

from egosplat.pipeline.config import defaults, stage_values

FRAMES = "results/mine/scene/frames.zarr"


@pytest.fixture
def pictures(tmp_path):
    """A folder of six photographs of 64x48."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(6):
        Image.new("RGB", (64, 48), (40 * number, 100, 0)).save(folder / f"{number}.png")
    return folder


def test_zero_cores_are_rejected_at_once(one_scene, pictures):
    done = one_scene("plain", pictures).snakemake("--cores", "0", "--", FRAMES)
    assert done.returncode != 0 and "egosplat: --cores 0: nothing can run" in done.stderr


def test_a_configuration_file_with_a_key_twice_is_rejected_with_both_lines(one_scene, pictures):
    workdir = one_scene("plain", pictures)
    (workdir.folder / "tiny.yaml").write_text("frames: {stride: 1}\nposes: {}\nframes: {focal: 400}\n")
    done = workdir.snakemake("--dry-run", "--", FRAMES)
    assert done.returncode != 0 and "tiny.yaml" in done.stderr
    assert "line 3, column 1: key 'frames' is set twice, first in line 1" in done.stderr


def test_numbers_of_the_command_line_and_with_an_exponent_are_numbers(one_scene, pictures):
    workdir = one_scene("plain", pictures)
    (workdir.folder / "tiny.yaml").write_text("poses: {max_dist_std: 1e-4}\n")
    options = ["--config", "frames={stride: 2, upright: false, end_s: null}", "poses={min_registered: 0.7}"]
    target = "results/mine/scene/poses.zarr"
    done = workdir.snakemake("--dry-run", "--printshellcmds", *options, "--", target)
    assert done.returncode == 0, done.stderr
    commands = done.stdout + done.stderr
    for value in ('"stride": 2,', '"upright": false', '"min_registered": 0.7,', '"max_dist_std": 0.0001,'):
        assert value in commands
    assert '"end_s": null' in commands


def test_the_last_word_of_a_run_that_failed_is_the_stage_s_message(one_scene, pictures):
    workdir = one_scene("plain", pictures, "frames.start_s=900 frames.evaluation_frames=1")
    done = workdir.snakemake("--", FRAMES)
    said = done.stderr.strip().splitlines()
    assert done.returncode != 0
    assert said[-1].startswith(f"egosplat: {FRAMES} was not made. ")
    assert "no frame between start_s and end_s" in said[-1]


def test_a_dry_run_with_another_preset_says_what_it_would_replace_and_how_to_keep_both(one_scene, pictures):
    workdir = one_scene("plain", pictures)
    options = stage_values("frames", defaults()) | {"format": "plain"}
    made = workdir.folder / FRAMES
    made.mkdir(parents=True)
    about = {"egosplat": {"provenance": {"stage": "frames", "options": options}}}
    (made / "zarr.json").write_text(json.dumps({"attributes": about}))
    done = workdir.snakemake("--dry-run", "--config", "preset=accurate", "--", FRAMES)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("egosplat: ")]
    (first,) = [line for line in said if "replaces frames.zarr" in line]
    assert "preset balanced -> accurate" in first and "frames.resolution 512 -> 704" in first
    assert any(" --cores 2 results/mine/scene/variants/accurate/metrics.json" in line for line in said)
    graph = workdir.snakemake("--rulegraph", "--config", "preset=accurate", "--", FRAMES)
    assert "replaces" not in graph.stderr, "nothing is replaced by a picture of the rules"
