"""The page of methods: which queries it shows, and a column for each method."""

import shutil

import matplotlib.image
import pytest

from egosplat.errors import UserError
from egosplat.evaluation import stage
from egosplat.report.sheets.queries_sheet import ScoredQuery
from egosplat_rivals.methods_sheet import over_methods, run

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
    widths = []
    for count in (1, 2):
        run(paths[:count], tmp_path / f"{count}.png", "adt/scene1")
        widths.append(matplotlib.image.imread(tmp_path / f"{count}.png").shape[1])
    assert widths[1] == pytest.approx(1.5 * widths[0], rel=0.02)
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
