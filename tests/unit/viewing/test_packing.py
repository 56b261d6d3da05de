"""The data of the scene page without a browser."""

import shutil

import numpy as np
import pytest
import torch
from scipy.cluster.vq import vq

from egosplat.language.decoder import Decoder
from egosplat.viewing.gaussians import (
    SMALLEST,
    STEP,
    fit_palette,
    keep_largest,
    pack_codes,
    pack_gaussians,
    pack_visibility,
    spatial_order,
    to_bytes,
)
from egosplat.viewing.html import pack
from tests.support.page_scene import (
    TITLE,
    contents_of,
    from_bytes,
    means_of,
    put_histories,
    scales_of,
    shares_of,
    unpack,
    wall,
    write_page,
)


def test_arrays_and_facts_come_back_and_a_number_that_is_not_finite_is_refused():
    rng, kinds = np.random.default_rng(0), ("uint8", "int8", "uint16", "float16", "float32")
    arrays = {name: rng.normal(0, 50, (3, 5)).clip(0, 100).astype(name) for name in kinds}
    arrays |= {"none": np.zeros((0, 4), np.float32), "turned": arrays["uint16"].T}
    facts = {"title": "</script><b>"}
    found_facts, found = unpack(pack(facts, arrays))
    assert found_facts == facts
    for name, values in arrays.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)
    with pytest.raises(ValueError):
        pack({"number": float("nan")}, {})


def test_gaussians_are_quantized_finely():
    gaussians = wall()
    gaussians = gaussians.select(torch.from_numpy(spatial_order(gaussians.means.numpy())))
    arrays, facts = pack_gaussians(gaussians, 1)
    assert np.abs(means_of(facts, arrays) - gaussians.means.numpy()).max() < 1e-4
    assert np.abs(scales_of(facts, arrays) / gaussians.scales.numpy() - 1).max() < 0.02
    assert np.abs(arrays["opacity"] / 255 - gaussians.opacities.numpy()).max() <= 0.5 / 255 + 1e-6
    turned = arrays["rotation"].T / np.linalg.norm(arrays["rotation"], axis=0)[:, None]
    quats = torch.nn.functional.normalize(gaussians.quats, dim=1).numpy()
    assert (turned * quats).sum(axis=1).min() > 0.9999
    bands = arrays["bands"].T / 127 * facts["band_limit"]
    assert np.median(np.abs(bands - gaussians.sh[:, 1:].reshape(-1, 9).numpy())) < 0.002


def test_thinning_keeps_what_covers_most():
    """Opacity times area: neither a large transparent nor a small opaque Gaussian is kept first."""
    gaussians = wall().select(torch.arange(3))
    gaussians.log_scales[:] = torch.tensor([[-3.0] * 3, [-1.0] * 3, [-2.0] * 3])
    gaussians.logit_opacities[:] = torch.tensor([6.0, -9.0, 4.0])
    assert keep_largest(gaussians, 2).tolist() == [2, 0]


def test_few_codes_are_kept_exactly_and_many_nearly():
    rng = np.random.default_rng(0)
    few = rng.normal(size=(40, 6)).astype(np.float32)
    rows = few[rng.integers(40, size=900)]
    many = (few[rng.integers(40, size=9000)] + rng.normal(0, 0.05, (9000, 6))).astype(np.float32)
    for values, error in ((rows, 0), (many, 0.05)):
        entries = fit_palette(values)
        assert len(entries) <= 512
        assert np.sqrt(((entries[vq(values, entries)[0]] - values) ** 2).mean()) <= error


def test_a_gaussian_without_a_code_has_none_on_the_page():
    code = np.eye(3, dtype=np.float32)[:, None].repeat(2, axis=1)
    # Shares that round to 0 stay above 0; a level without any code has an empty palette.
    share = np.float32([[1, 0], [0.0001, 0], [0, 0]])
    arrays = pack_codes(code, share, Decoder((3,), np.zeros(0, np.float32)))
    assert arrays["code_share"].tolist() == [[255, 1, 0], [0, 0, 0]]
    assert not arrays["palette"][1].any()
    np.testing.assert_array_equal(arrays["palette"][0][arrays["code_index"][0, :2]], code[:2, 0])


def test_visible_shares_come_back_within_a_step():
    rng = np.random.default_rng(0)
    shares = np.exp(rng.uniform(np.log(1e-8), np.log(1e-2), (40, 50))).astype(np.float32)
    arrays, facts = pack_visibility(shares, np.arange(40) * 3)
    views, mean = shares_of(facts | {"count": 50}, arrays)
    assert len(views) == 32 and facts["seen_frames"][-1] == 117
    chosen = shares[np.array(facts["seen_frames"]) // 3]
    shown = chosen >= SMALLEST
    assert not views[~shown].any()
    assert np.abs(np.log(views[shown] / chosen[shown])).max() <= np.log(STEP) / 2 + 1e-5
    assert np.abs(np.log(mean / shares.mean(axis=0))).max() <= np.log(STEP) / 2 + 1e-5
    assert from_bytes(to_bytes(np.float32([0, 2]), SMALLEST), SMALLEST)[0] == 0


def test_a_page_escapes_its_title_and_asks_for_nothing_outside_of_itself(page_scene):
    text = (page_scene / "scene.html").read_text()
    assert TITLE not in text and "&lt;/script&gt;" in text
    assert "http://" not in text and "https://" not in text and "<!--{" not in text
    facts, arrays = contents_of(page_scene / "scene.html")
    assert facts["title"] == TITLE and facts["trained_count"] == facts["count"] == 700
    assert arrays["poses"].shape == (4, 3, 4) and facts["frames"] == [0, 1, 2, 4]
    assert set(np.unique(arrays["instance"])) == {1, 2, 3, 4, 5, 6}


@pytest.mark.parametrize("spans", [(), ((0, 1), (2, 4), (1, 1))])
def test_rests_follow_what_stays(tmp_path, page_scene, spans):
    folder = shutil.copytree(page_scene, tmp_path / "scene")
    before = contents_of(folder / "scene.html")
    own = put_histories(folder, spans)
    facts, arrays = contents_of(write_page(folder))
    assert facts["count"] == 700 and facts["drawn"] == 700 + own.count == arrays["opacity"].size
    rests = [(one["from"], one["until"], one["count"]) for one in facts["rests"]]
    assert rests == [(0.1 * first, 0.1 * last, 4) for first, last in spans]
    assert np.abs(means_of(facts, arrays)[700:] - own.means.numpy()).max(initial=0) < 1e-3
    for name in ("code_index", "code_share", "instance", "visible", "seen"):
        np.testing.assert_array_equal(arrays[name], before[1][name])
    assert before[0]["rests"] == [] and before[0]["count"] == before[0]["drawn"] == 700
    assert [len(carries) for carries in facts["carried_things"]] == ([1] if spans else [])
