"""The numbers of a query."""

from dataclasses import replace

import pytest

from egosplat.query.options import CANONICAL, LANGSPLAT


def test_langsplat():
    assert CANONICAL == ("object", "things", "stuff", "texture")
    assert (LANGSPLAT.temperature, LANGSPLAT.smoothing_px, LANGSPLAT.majority_px) == (10.0, 30, 7)
    assert LANGSPLAT.segmentation_threshold == 0.7


@pytest.mark.parametrize(
    "name, value",
    [
        ("canonical", ()),
        ("temperature", 0.0),
        ("temperature", float("nan")),
        ("temperature", float("inf")),
        ("resolution", -1),
        ("min_coverage", 0.0),
        ("min_coverage", 1.0),
        ("smoothing_px", 0),
        ("segmentation_threshold", 1.0),
        ("majority_px", 6),
    ],
)
def test_what_is_out_of_range_is_named(name, value):
    with pytest.raises(ValueError, match=name):
        replace(LANGSPLAT, **{name: value})
