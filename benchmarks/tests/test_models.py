"""Benchmarks of models and of merging run at their smallest size."""

import json

from click.testing import CliRunner

from benchmarks.instances import growth
from benchmarks.published_models import __main__ as published_models
from benchmarks.segments_growth import __main__ as segments_growth
from tests.support.tables import cells
from tests.unit.models.conftest import tiny_clip, tiny_sam2

__all__ = ["tiny_clip", "tiny_sam2"]


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


def test_every_mask_of_noise_is_tracked():
    """As many instances as are asked for, or the law would be of others."""
    (found,) = run(segments_growth.main, "--size", 64, "--point", 2, 6).splitlines()
    assert json.loads(found)["instances"] == 6


def test_laws_are_fitted_to_measurements(monkeypatch):
    """Two seconds and three for each frame; 10 MiB and one for each instance."""
    measured = [
        {"frames": f, "instances": n, "seconds": 2 * f + 3 * f * n, "before_mb": 5.0, "peak_mb": 10.0 + n}
        for f, n in segments_growth.POINTS
    ]
    monkeypatch.setattr(segments_growth, "measure_apart", lambda *_: measured.pop(0))
    said = run(segments_growth.main)
    assert len(cells(said)) == 1 + len(segments_growth.POINTS)
    assert "2 F + 3 F N (largest error 0%)" in said and "1 N (largest error 0%)" in said


def test_made_up_masks_are_merged_to_the_instances_they_show():
    frames, gaussians, masks, _, instances, *_ = run(growth.main, "--one", 12, 3000, 0).strip().split("|")
    assert (frames, gaussians) == ("12", "3,000")
    assert 0 < int(instances) <= growth.INSTANCES < int(masks)
