"""A scene's size is read from its artifacts' headers, and asked for only once they are there."""

from pathlib import Path

import pytest
import zarr

from egosplat.cluster.shapes import Shapes


@pytest.fixture
def artifacts(tmp_path: Path) -> list[str]:
    """Arrays of the sizes of a scene, without a value."""
    shapes = {
        "frames.zarr/rgb": (7, 20, 30, 3),
        "segments.zarr/labels": (7, 3, 20, 30),
        "segments.zarr/instances/level": (11,),
        "view_features.zarr/feature": (40, 512),
        "splats.zarr/means": (900, 3),
    }
    for path, shape in shapes.items():
        store, _, name = path.partition("/")
        zarr.open_group(tmp_path / store, mode="a").create_array(name, shape=shape, dtype="u1")
    return [str(tmp_path / f"{stage}.zarr") for stage in ("frames", "segments", "view_features", "splats")]


def test_sizes_are_those_of_the_arrays(artifacts):
    scene = Shapes([*artifacts, "somewhere/trajectory.csv", "results/poses.zarr"])
    assert (scene.frames, scene.pixels) == (7, 600)
    assert (scene.instances, scene.views, scene.channels, scene.gaussians) == (11, 40, 512, 900)


def test_labels_tell_the_pictures_size_as_well(artifacts):
    scene = Shapes(artifacts[1:2])
    assert (scene.frames, scene.pixels) == (7, 600)


def test_what_is_still_to_be_made_is_named_as_it_was_given(artifacts, tmp_path):
    later = str(tmp_path / "later" / "frames.zarr")
    scene = Shapes([later])
    with pytest.raises(FileNotFoundError) as raised:
        _ = scene.pixels
    assert raised.value.filename == later


def test_a_size_that_no_input_tells_is_no_missing_file(artifacts):
    with pytest.raises(LookupError, match="gaussians"):
        _ = Shapes(artifacts[:1]).gaussians


def test_the_headers_are_those_of_the_artifacts_as_they_are_written():
    from egosplat.artifacts.registry import SCHEMAS
    from egosplat.cluster.shapes import _TOLD_BY

    names = {
        "frames": {"frame"},
        "pixels": {"height", "width"},
        "instances": {"instance"},
        "views": {"view"},
        "channels": {"channel"},
        "gaussians": {"gaussian"},
    }
    for size, sources in _TOLD_BY.items():
        for artifact, array, axes in sources:
            assert set(SCHEMAS[artifact].fields[array].dims[axes]) == names[size], (size, artifact)
