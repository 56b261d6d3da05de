"""A variant makes the artifacts that its keys change, and shares the others."""

import shutil

import pytest

from egosplat_rivals.scored_scenes import read_scored_scene
from egosplat_rivals.tables.paper_numbers import in_a_table

SCENE = "results/adt/scene1"
VARIANT = f"{SCENE}/variants"


@pytest.mark.parametrize(
    "target, expected",
    [
        ("baseline/language.zarr", {"features", "splats", "language"}),
        ("no_masks/language.zarr", {"splats", "language"}),
        ("network_masks/splats.zarr", {"splats"}),
        ("lerf/metrics.json", {"tiles", "splats", "language", "metrics"}),
        ("occam/language.zarr", {"segments", "instances", "view_features", "features", "splats", "language"}),
    ],
)
def test_a_variant_makes_only_what_its_keys_change(unchanged, target, expected):
    assert unchanged.stale(f"{VARIANT}/{target}") == expected


METHODS = {"langsplat": "LangSplat", "occam": "Occam's LGS", "occam_pixels": "Occam's LGS"}


@pytest.mark.slow
def test_methods_end_in_scores_that_the_tables_place(workdir):
    """Without its language.zarr, a method is made again from there on; other methods stay."""
    scores = {name: f"{VARIANT}/{name}/metrics.json" for name in METHODS}
    done = workdir.snakemake("--", *scores.values())
    assert done.returncode == 0, done.stdout + done.stderr
    for name, method in METHODS.items():
        scored = read_scored_scene(workdir.folder / scores[name])
        assert scored.method == method and in_a_table(scored) and scored.document["stands_in"]
        assert (scored.readout == "pixels") == name.endswith("pixels")
    assert workdir.stale(*scores.values()) == set()
    codes = f"{VARIANT}/occam/language.zarr"
    shutil.rmtree(workdir.folder / codes)
    assert workdir.stale(codes, *scores.values()) == {"language", "metrics"}


def test_a_user_variant_is_made_next_to_the_scene(workdir):
    (workdir.folder / "mine.yaml").write_text("variants: {rough: {splats: {masking: none, iterations: 10}}}")
    target = f"{VARIANT}/rough/splats.zarr"
    done = workdir.snakemake("mine.yaml", "--", target)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 1 steps" in done.stdout + done.stderr
    assert (workdir.folder / target).is_dir()
    again = workdir.snakemake("mine.yaml", "--dry-run", "--", target, f"{SCENE}/splats.zarr")
    assert "Nothing to be done" in again.stdout + again.stderr
