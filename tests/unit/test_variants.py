"""Which artifacts a variant makes anew, and which it shares with its scene."""

import pytest

from egosplat.config import defaults, merge
from egosplat.errors import UserError
from egosplat.stages import STAGES
from egosplat.variants import inputs_of, optional_inputs_of, reaches, variant_config

BASE = defaults()


def reached(**keys: dict[str, object]) -> set[str]:
    """The stages that these keys make anew, pictures left out."""
    changed = merge(BASE, keys)
    return {name for name in STAGES if not name.endswith("_sheet") and reaches(name, BASE, changed)}


def test_a_key_reaches_its_stage_and_those_after_it():
    assert reached(features={"mad_k": 2.0}) >= {"features", "language"}
    assert reached(features={"mad_k": 2.0}).isdisjoint({"view_features", "splats", "masks"})
    assert reached(splats={"masking": "none"}) >= {"splats", "language"}
    assert reached(splats={"masking": "none"}).isdisjoint({"masks", "transient", "features"})
    assert reached(transient={"lambda2": 0.1}) >= {"transient", "masks", "splats", "language"}
    assert reached(frames={"stride": 3}) >= {"frames", "poses", "segments", "features", "transient", "splats"}


def test_codes_trained_with_the_geometry_tie_it_to_the_features():
    joint = {"language": "joint"}
    assert "splats" not in reached(features={"dims": 4})
    base = merge(BASE, {"splats": joint})
    assert reaches("splats", base, merge(base, {"features": {"dims": 4}}))


def test_a_models_key_reaches_the_stages_that_take_it():
    assert reached(models={"clip_model": "other"}) >= {"view_features", "features", "language"}
    assert reached(models={"clip_model": "other"}).isdisjoint({"segments", "splats"})


def test_the_same_values_reach_nothing():
    assert reached(splats={"masking": BASE["splats"]["masking"]}) == set()


@pytest.mark.parametrize(
    "masking, language, expected",
    [
        ("none", "after", ()),
        ("initial", "after", ("transient",)),
        ("refined", "joint", ("masks", "segments", "features")),
    ],
)
def test_what_the_splats_need_depends_on_their_keys(masking, language, expected):
    config = merge(BASE, {"splats": {"masking": masking, "language": language}})
    assert optional_inputs_of("splats", config) == expected
    assert inputs_of("splats", config) == ("frames", "poses", *expected)
    assert optional_inputs_of("language", config) == tuple(n for n in expected if n in ("transient", "masks"))


def test_a_variant_is_its_keys_over_the_scenes():
    scene = merge(BASE, {"splats": {"iterations": 5}, "variants": {"mine": {"splats": {"masking": "none"}}}})
    found = variant_config(scene, "mine", "adt/scene1")
    assert (found["splats"]["masking"], found["splats"]["iterations"]) == ("none", 5)


@pytest.mark.parametrize(
    "variants, name, message",
    [
        ({}, "mine", "no variant 'mine'.*take one of: baseline"),
        ({"mine": {"splats": {"masking": "all"}}}, "mine", r"variant mine: splats\.masking = 'all'"),
        ({"mine": {"splat": {"masking": "none"}}}, "mine", "did you mean 'splats'"),
        ({"mine": {"synthetic": {"seed": 9}}}, "mine", "leave out the section synthetic"),
    ],
)
def test_a_variant_that_cannot_be_is_refused(variants, name, message):
    scene = merge(BASE, {"variants": variants})
    with pytest.raises(UserError, match=message):
        variant_config(scene, name, "adt/scene1")
