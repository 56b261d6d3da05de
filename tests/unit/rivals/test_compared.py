"""Scores that the tables and the page of speed against accuracy wait for."""

from dataclasses import replace
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import merge, resolve
from egosplat.run.jobs import default_results
from egosplat_rivals.compared import compared_variants, table_pictures, table_scores
from tests.unit.run.test_jobs import PRESETS, scenes

__all__ = ("scenes",)


def test_the_tables_hold_ablations_configured_methods_and_scores_by_name_that_exist(scenes):
    before, home = table_scores(scenes.values()), "results/adt/one"
    own = ("baseline", "langsplat", "langsplat_pixels", "pixels")
    assert {f"{home}/variants/{name}/metrics.json" for name in own} <= {*before}
    assert "results/mine/here/variants/baseline/metrics.json" in before
    assert not [path for path in before if "named" in path or "absent" in path]
    assert not [path for path in default_results(scenes["adt", "one"]) if "variants" in path]
    Path("results/adt/named").mkdir(parents=True)
    Path("results/adt/named/metrics.json").touch()
    assert set(table_scores(scenes.values())) - set(before) == {"results/adt/named/metrics.json"}
    keys = {"tables": {"methods": []}}
    told = [replace(scene, config=merge(scene.config, keys)) for scene in scenes.values()]
    assert not [path for path in table_scores(told) if "langsplat" in path]
    assert {"results/mine/here/splats.png", f"{home}/methods.png"} <= {*table_pictures(scenes.values())}
    assert f"{home}/methods.png" not in table_pictures(told)


def test_variants_that_change_nothing_are_not_compared(scenes):
    variants = {"same": {}, "narrow": {"features": {"dims": 8}}}
    keys = {"variants": variants, "tradeoff": {"variants": ["same", "narrow"]}}
    scene = replace(scenes["adt", "one"], config=resolve(keys, PRESETS))
    home = "results/adt/one"
    assert compared_variants(scene) == [f"{home}/metrics.json", f"{home}/variants/narrow/metrics.json"]
    lost = replace(scene, config=resolve({"tradeoff": {"variants": ["nothing"]}}, PRESETS))
    with pytest.raises(UserError, match="adt/one: no variant 'nothing'"):
        compared_variants(lost)
