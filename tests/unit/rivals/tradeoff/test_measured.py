"""What a point cost and reached, as metrics.json tells it."""

import json
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat_rivals.tradeoff.measured import CPU, DISK, MEMORY, PSNR, WALL, read_points

NO_RECIPE = {"keys": {}, "command": "snakemake"}


def change(path: str, **changes) -> None:
    """Put values into the record of the splats."""
    content = json.loads(Path(path).read_text())
    content["artifacts"]["splats.zarr"] |= changes
    Path(path).write_text(json.dumps(content))


def test_costs_are_of_what_makes_the_scene(scored):
    (one,) = read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [scored(None, minutes=10.0)]}])
    values = {measure.name: one.sample(measure) for measure in (WALL, CPU, MEMORY, DISK)}
    # The reading of annotations, ten minutes, and the asking are no part of it.
    assert values == {"wall_s": (601.0,), "cpu_s": (1202.0,), "peak_memory_mb": (1100.0,), "disk_mb": (20.0,)}
    assert one.stage_costs()["metrics"]["wall_s"] == 30.0
    assert one.about == "synthetic apartments, small checkpoints"


def test_an_interrupted_training_counts_whole(scored):
    path = scored(None, minutes=1.0)
    change(path, training_s=500.0)
    (one,) = read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [path]}])
    assert one.sample(WALL) == (501.0,)


def test_missing_costs_are_unknown(scored):
    path = scored(None, psnr=None)
    content = json.loads(Path(path).read_text())
    del content["artifacts"]["splats.zarr"]["cpu_s"]
    Path(path).write_text(json.dumps(content))
    (one,) = read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [path]}])
    assert one.sample(CPU) is None and one.sample(PSNR) is None
    assert one.stage_costs()["splats"]["cpu_s"] is None
    assert one.queries == 80


def test_settings_are_labeled_by_their_keys(three_points):
    labels = [one.label for one in read_points(three_points)]
    assert labels == ["the scene (balanced)", "paper_scaled", "splats.iterations=1500"]


def test_a_missing_artifact_is_named(scored):
    path = scored(None)
    content = json.loads(Path(path).read_text())
    content["artifacts"]["masks.zarr"] = None
    Path(path).write_text(json.dumps(content))
    with pytest.raises(UserError, match="masks.zarr"):
        read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [path]}])


def test_scores_of_other_scenes_or_questions_are_rejected(scored, tmp_path):
    first = scored(None)
    other = tmp_path / "results/adt/scene2/metrics.json"
    other.parent.mkdir(parents=True)
    other.write_text(Path(first).read_text().replace("adt/scene1", "adt/scene2"))
    with pytest.raises(UserError, match="another scene"):
        read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [first, str(other)]}])
    stricter = Path(scored("strict"))
    stricter.write_text(stricter.read_text().replace('"hit_region": "box"', '"hit_region": "mask"'))
    with pytest.raises(UserError, match="metrics.hit_region"):
        read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [first, str(stricter)]}])
    with pytest.raises(UserError, match="does not exist"):
        read_points([{"settings": [], "recipe": NO_RECIPE, "metrics": [str(tmp_path / "metrics.json")]}])
