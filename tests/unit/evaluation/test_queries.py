"""What is asked in the benchmark."""

import numpy as np
import pytest

from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import Query, categories, find_queries, read_layers

ALL = ScoringOptions(min_area=0.0, excluded=())


def asked(instance_map, instances, options: ScoringOptions) -> dict[str, dict[str, tuple[int, ...]]]:
    return dict(categories(instance_map[None], instances, options))


def test_a_query_is_a_category_with_all_its_instances(instance_map, instances):
    assert asked(instance_map, instances, ALL) == {
        "book": {"static": (1,), "dynamic": (2,), "all": (1, 2)},
        "dining chair": {"static": (0,), "all": (0,)},
        "shelter": {"static": (4,), "all": (4,)},
    }
    assert [*asked(instance_map, instances, ALL.change(excluded=("shelter",)))] == ["book", "dining chair"]
    # Hidden categories are not queried.
    instance_map[instance_map == 2] = 4
    assert asked(instance_map, instances, ALL)["book"] == {"static": (1,), "all": (1,)}
    for some in (instances, []):
        assert asked(np.full((3, 3), -1, np.int32), some, ALL) == {}


@pytest.mark.parametrize(
    "pixels, expected",
    [
        (24, {"static": (1,), "dynamic": (2,), "all": (1, 2)}),
        (25, {"dynamic": (2,), "all": (1, 2)}),
        (61, {"all": (1, 2)}),
        (85, None),
    ],
)
def test_each_group_has_to_be_large_enough(instance_map, instances, pixels, expected):
    options = ScoringOptions(min_area=pixels / instance_map.size, excluded=())
    assert asked(instance_map, instances, options).get("book") == expected


def test_frames_without_annotation_are_left_out(annotations, instance_map):
    artifact = annotations(np.stack([instance_map] * 3), [True, False, True])
    options = ScoringOptions(min_area=0.06, excluded=("shelter",))
    found = find_queries(artifact, np.ones(instance_map.shape, bool), options)
    groups = {"static": (0,), "all": (0,)}
    chairs = [Query(row, frame, "dining chair", groups) for row, frame in ((0, 10), (2, 30))]
    assert [one for one in found if one.category == "dining chair"] == chairs and len(found) == 4


def test_only_valid_pixels_count(annotations, instance_map):
    artifact = annotations(instance_map[None], [True])
    valid = np.zeros(instance_map.shape, bool)
    valid[:11] = True
    assert [one.category for one in find_queries(artifact, valid, ALL)] == ["dining chair", "shelter"]
    assert (read_layers(artifact, 0, valid)[0][11:] == -1).all()
    np.testing.assert_array_equal(read_layers(artifact, 0, valid)[0][:11], instance_map[:11])
