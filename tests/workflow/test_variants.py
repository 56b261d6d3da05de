"""Variants make anew what their keys reach, and share the rest."""

import pytest

SCENE = "results/adt/scene1"
VARIANT = f"{SCENE}/variants"


@pytest.mark.parametrize(
    "target, expected",
    [
        ("baseline/language.zarr", {"features", "splats", "language"}),
        ("aggregation/language.zarr", {"splats", "language"}),
        ("initial/splats.zarr", {"splats"}),
    ],
)
def test_only_what_is_reached_is_made(workdir, target, expected):
    assert workdir.stale(f"{VARIANT}/{target}") == expected


def test_a_variant_of_ones_own_stands_beside_the_scene(workdir):
    (workdir.folder / "mine.yaml").write_text("variants: {rough: {splats: {masking: none, iterations: 10}}}")
    target = f"{VARIANT}/rough/splats.zarr"
    done = workdir.snakemake("mine.yaml", "--", target)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 1 steps" in done.stdout + done.stderr
    assert (workdir.folder / target).is_dir()
    again = workdir.snakemake("mine.yaml", "--dry-run", "--", target, f"{SCENE}/splats.zarr")
    assert "Nothing to be done" in again.stdout + again.stderr


@pytest.mark.parametrize(
    "target, message",
    [
        ("nope/splats.zarr", "no variant 'nope'"),
        ("initial/frames.zarr", f"variant initial changes nothing of frames.zarr; take {SCENE}/frames.zarr"),
    ],
)
def test_what_cannot_be_asked_for_is_told_in_one_line(workdir, target, message):
    done = workdir.snakemake("--dry-run", "--", f"{VARIANT}/{target}")
    assert done.returncode != 0
    said = done.stdout + done.stderr
    assert message in said and "Traceback" not in said
