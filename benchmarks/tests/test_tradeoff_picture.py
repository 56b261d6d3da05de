"""Test of the picture of speed against accuracy."""

import cv2

from benchmarks.figures import difference
from benchmarks.rows import POOL, read_source
from benchmarks.tradeoff.__main__ import draw


def test_the_picture_of_the_trade_shows_what_pages_quote(tmp_path):
    rows = read_source(POOL)
    points = draw(rows, tmp_path / "trade.png").set_index(["preset", "panel"])
    told = difference(rows, "full", "draft", "accuracy")
    gain = points.loc["balanced", "accuracy [points]"]
    assert told.startswith(f"{gain.gain:+.1f} ({gain.low:+.1f} to {gain.high:+.1f})")
    assert points.loc["accurate", "static PSNR, own size [dB]"].low > 1
    assert (points["t_low"] <= points["gain"]).all() and (points["gain"] <= points["high"]).all()
    assert cv2.imread(str(tmp_path / "trade.png")).std() > 10
