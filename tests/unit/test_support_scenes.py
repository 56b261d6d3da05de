"""The builder of the tests' artifacts writes what the readers accept."""

import numpy as np
import pytest

from egosplat.artifacts.reader import recorded_digest, verify
from egosplat.artifacts.registry import SCHEMAS
from tests.support.scenes import put, put_scene


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_kind_is_written_with_values_of_its_own(tmp_path, name):
    made = verify(put(tmp_path, name, size=2, facts={"a": 1}, options={"b": 2}, origin="real"), SCHEMAS)
    assert (made.facts, made.origin, made.provenance["options"]) == ({"a": 1}, "real", {"b": 2})


def test_arrays_and_sizes_of_a_scene_are_those_given(tmp_path):
    labels = np.full((3, 2, 4, 5), -1, np.int32)
    arrays = {
        "rgb": np.zeros((3, 4, 5, 3), np.uint8),
        "train": np.array([True, False, True]),
        "labels": labels,
    }
    frames, segments = put_scene(tmp_path, ["frames", "segments"], arrays, chained=True)
    made = verify(segments, SCHEMAS)
    assert made.provenance["inputs"] == {"frames.zarr": recorded_digest(frames)}
    assert (made.read("labels") == labels).all()
    assert verify(frames, SCHEMAS).read("evaluation").tolist() == [False, True, False]


@pytest.mark.parametrize("name", ["label", "rgb"])
def test_an_array_that_no_artifact_has_is_an_error(tmp_path, name):
    with pytest.raises(KeyError, match=name):
        put_scene(tmp_path, ["segments"], {name: np.zeros(1)})
