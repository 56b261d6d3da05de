"""Benchmarks of models and of merging run at their smallest size."""

import json

from click.testing import CliRunner

from benchmarks.instances import growth
from benchmarks.published_models import __main__ as published_models
from tests.unit.models.conftest import tiny_sam2

__all__ = ["tiny_sam2"]


def run(command, *words) -> str:
    done = CliRunner().invoke(command, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_published_architecture_is_saved_loaded_and_run(tiny_sam2, tiny_clip, tmp_path):
    """On tiny ones. The command checks that the loaded weights are the saved ones, which a changed file is not."""
    architectures = ("--sam2", tiny_sam2 / "sam2.yaml", "--clip", tiny_clip)
    expected = {
        "sam2": ("an image, resized to 256x256", "a point in it"),
        "clip": ("an image of 32x32", "a text"),
    }
    for name, what in expected.items():
        path = tmp_path / f"{name}.pt"
        run(published_models.main, *architectures, "--save", name, path)
        loading, *rows = json.loads(run(published_models.main, *architectures, "--measure", name, path))
        assert loading[1] == "loading" and float(loading[2]) >= 0
        assert [row[1] for row in rows] == list(what)


def test_made_up_masks_are_merged_to_the_instances_they_show():
    frames, gaussians, masks, _, instances, *_ = run(growth.main, "--one", 12, 3000, 0).strip().split("|")
    assert (frames, gaussians) == ("12", "3,000")
    assert 0 < int(instances) <= growth.INSTANCES < int(masks)
