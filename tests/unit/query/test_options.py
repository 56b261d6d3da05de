"""The numbers of a query."""

import pytest

from egosplat.query.options import CANONICAL, LANGSPLAT, QueryOptions


def test_defaults_are_langsplats():
    assert CANONICAL == ("object", "things", "stuff", "texture")
    assert (LANGSPLAT.temperature, LANGSPLAT.segmentation_threshold) == (10.0, 0.7)
    assert (LANGSPLAT.box_filter_px(1408), LANGSPLAT.majority_px(1408)) == (30, 7)


@pytest.mark.parametrize("longer, smoothing, majority", [(1056, 22, 5), (512, 11, 3), (96, 2, 1), (1, 1, 1)])
def test_squares_go_with_the_picture(longer, smoothing, majority):
    assert (LANGSPLAT.box_filter_px(longer), LANGSPLAT.majority_px(longer)) == (smoothing, majority)


def test_the_configuration_s_defaults_are_langsplat_s():
    # LangSplat answers everything; its least score is where a query fits as well as the canonical phrases.
    assert QueryOptions().change(min_score=0.5) == LANGSPLAT


OUT_OF_RANGE = {"canonical": [()], "temperature": [0.0, float("nan"), float("inf")], "resolution": [-1]}
OUT_OF_RANGE |= {"box_filter": [-0.1], "segmentation_threshold": [1.0]}
OUT_OF_RANGE |= {"majority_filter": [1.1], "min_score": [-0.1, 1.1]}


@pytest.mark.parametrize("name, value", [(name, one) for name, some in OUT_OF_RANGE.items() for one in some])
def test_values_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        LANGSPLAT.change(**{name: value})
