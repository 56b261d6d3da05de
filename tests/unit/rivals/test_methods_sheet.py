"""Pages that compare: the scores that they wait for, and the page of methods."""

import shutil
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import pytest

from egosplat.errors import UserError
from egosplat.evaluation import stage
from egosplat.pipeline.config import merge, resolve
from egosplat.report.sheets.queries_sheet import ScoredQuery
from egosplat.run.jobs import default_results
from egosplat_rivals.compared import compared_variants, table_pictures, table_scores
from egosplat_rivals.methods_sheet import over_methods, run
from tests.unit.run.test_jobs import PRESETS, scenes

NAMES = ("frames", "poses", "annotations", "features", "splats", "language")


def scored(folder, home, method=None):
    home.mkdir(exist_ok=True, parents=True)
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in NAMES}
    output = home / "metrics.json"
    stage.run(**paths, output=output, options=stage.MetricsOptions(), title="adt/scene1", method=method)
    return output


def test_each_method_has_a_column_and_a_lost_input_is_named(word_scene, tmp_path):
    folder = word_scene()
    paths = [scored(folder, folder), scored(folder, folder / "variants" / "occam", "Occam's LGS")]
    for count in (1, 2):
        run(paths[:count], tmp_path / f"{count}.png", "adt/scene1")
    widths = [matplotlib.image.imread(tmp_path / f"{count}.png").shape[1] for count in (1, 2)]
    assert widths[1] == pytest.approx(1.5 * widths[0], rel=0.02)
    paths[1].write_text(paths[1].read_text().replace("adt/scene1", "adt/scene2"))
    with pytest.raises(UserError, match=f"{paths[1]}: is of another scene"):
        run(paths, tmp_path / "page.png", "adt/scene1")
    shutil.rmtree(folder / "poses.zarr")
    with pytest.raises(UserError, match=r"lacks poses\.zarr"):
        run(paths[:1], tmp_path / "page.png", "adt/scene1")


def asked(**rows):
    return {(0, name): ScoredQuery(0, name, 0.5, hit, iou) for name, (hit, iou) in rows.items()}


def test_queries_count_by_what_most_methods_answer():
    one = asked(cup=(True, 0.8), sofa=(False, 0.1), rug=(True, 0.4), alone=(True, 1.0))
    two = asked(cup=(False, 0.2), sofa=(False, 0.3), rug=(True, 0.6))
    found = {query.category: (query.hit, round(query.iou, 6)) for query in over_methods([one, two])}
    assert found == {"cup": (True, 0.5), "rug": (True, 0.5), "sofa": (False, 0.2)}


__all__ = ("scenes",)


def test_the_tables_hold_ablations_configured_methods_and_scores_by_name_that_exist(scenes):
    before, home = table_scores(scenes.values()), "results/adt/one"
    own = ("baseline", "langsplat", "langsplat_pixels", "pixels")
    assert {f"{home}/variants/{name}/metrics.json" for name in own} <= {*before}
    assert not [path for path in before if "named" in path or "absent" in path or "mine" in path]
    assert not [path for path in default_results(scenes["adt", "one"]) if "variants" in path]
    Path("results/adt/named").mkdir(parents=True)
    Path("results/adt/named/metrics.json").touch()
    assert set(table_scores(scenes.values())) - set(before) == {"results/adt/named/metrics.json"}
    told = [replace(one, config=merge(one.config, {"tables": {"methods": []}})) for one in scenes.values()]
    assert not [path for path in table_scores(told) if "langsplat" in path]
    assert {*table_pictures(scenes.values())} == {f"{home}/splats.png", f"{home}/methods.png"}
    assert f"{home}/methods.png" not in table_pictures(told)


def test_variants_that_change_nothing_are_not_compared(scenes):
    variants = {"same": {}, "narrow": {"features": {"dims": 8}}}
    keys = {"variants": variants, "tradeoff": {"variants": ["same", "narrow"]}}
    scene = replace(scenes["adt", "one"], config=resolve(keys, PRESETS))
    home = "results/adt/one"
    assert compared_variants(scene) == [f"{home}/metrics.json", f"{home}/variants/narrow/metrics.json"]
    with pytest.raises(UserError, match="adt/one: no variant 'nothing'"):
        compared_variants(replace(scene, config=resolve({"tradeoff": {"variants": ["nothing"]}}, PRESETS)))
