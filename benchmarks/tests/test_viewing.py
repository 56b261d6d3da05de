"""The benchmark of the scene page makes scenes with many Gaussians that are as sound as any."""

import numpy as np

from benchmarks.viewing import pages
from benchmarks.viewing.multiplied import multiply
from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from tests.support.page_scene import contents_of, put_page_scene, write_page


def test_a_multiplied_scene_has_copies_of_all_gaussians(tmp_path):
    given, scene = tmp_path / "given", tmp_path / "many"
    given.mkdir()
    gaussians = put_page_scene(given)
    multiply(given, scene, 3)
    splats, language = (verify(scene / f"{name}.zarr", SCHEMAS) for name in ("splats", "language"))
    count = gaussians.count
    assert splats.shape("means")[0] == language.shape("code")[0] == 3 * count
    means = splats.read("means")
    np.testing.assert_array_equal(means[:count], gaussians.means.numpy())
    assert np.abs(means[count : 2 * count] - means[:count]).max() > 0
    np.testing.assert_array_equal(language.read("code")[2 * count :], language.read("code")[:count])
    facts, _ = contents_of(write_page(scene, max_gaussians=count))
    assert facts["trained_count"] == 3 * count and facts["count"] == count


def test_the_table_has_a_cell_for_each_column():
    lines = pages.table([["1"] * len(pages.HEADER)]).splitlines()
    assert len({line.count("|") for line in lines}) == 1
