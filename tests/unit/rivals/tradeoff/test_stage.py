"""From the scores of variants to files."""

import itertools

import pandas as pd
import pytest
from PIL import Image

from egosplat.drawing import plt
from egosplat.errors import UserError
from egosplat.models.suitability import BRIEF, notice
from egosplat_rivals.tradeoff.chart import place_labels
from egosplat_rivals.tradeoff.stage import run


def test_all_files_name_their_scene_and_the_same_inputs_make_the_same_bytes(variant, tmp_path):
    three = [variant(None, 0.5, 10.0), variant("paper_scaled", 0.5, 100.0), variant("cheap", 0.4, 2.5)]
    run(three, tmp_path / "out")
    first = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    text = (tmp_path / "out/tradeoff.html").read_text()
    about = "synthetic apartments, small checkpoints"
    assert f"<title>Speed against accuracy: adt/scene1, {about}</title>" in text
    assert "cheap ◆" in text and "the scene ◆" in text and "paper_scaled ◆" not in text
    assert "a processor, 2 cores" in text and "several machines" not in text
    assert "data:image/webp;base64," in text and "50.0\n40.0–60.0" in text
    assert "a random pixel 5.0 %, the middle of the picture 15.0 %." in text
    with Image.open(tmp_path / "out/tradeoff.png") as picture:
        assert picture.width > 1000
    table = pd.read_csv(tmp_path / "out/tradeoff.csv").set_index(["point", "stage", "measure"]).value
    assert table["cheap"][float("nan"), "accuracy"] == 0.4
    assert table["paper_scaled", "splats", "wall_s"] == 6000
    run(three, tmp_path / "out")
    assert len(first) == 3 and first == {path: path.read_bytes() for path in first}


def test_small_checkpoints_on_a_real_recording_are_reported(variant, tmp_path):
    told = notice("real", {"clip_checkpoint": "small"})
    run([variant(None, origin="real", notice=told)], tmp_path)
    text = (tmp_path / "tradeoff.html").read_text()
    assert told in text and BRIEF in text[: text.index("</title>")]


@pytest.mark.parametrize("psnr", [None, 25.0])
def test_a_scene_without_queries_is_a_page_without_a_front(variant, tmp_path, psnr):
    nothing = dict.fromkeys(("accuracy", "mean_iou", "random_pixel", "middle_pixel"))
    nothing |= {"count": 0, "categories": 0, "accuracy_interval": None, "mean_iou_interval": None}
    own = {"frames": 3, "psnr": psnr, "ssim": None}
    rendering = dict.fromkeys(("static", "dynamic", "all"), own)
    scores = dict.fromkeys(("static", "dynamic", "all"), nothing)
    run([variant(None, scores=scores, rendering=rendering)], tmp_path)
    text = (tmp_path / "tradeoff.html").read_text()
    assert "◆<" not in text and "a random pixel - %" in text


def test_several_scenes_are_one_page_with_the_mean_of_their_common_variants(variant, tmp_path):
    paths = [variant(None, 0.5), variant("draft", 0.4, 1.0), variant("own", 0.9, 300.0)]
    paths += [variant(None, 0.6, scene="scene2"), variant("draft", 0.7, 2.0, scene="scene2")]
    run(paths, tmp_path)
    means, scenes = (tmp_path / "tradeoff.html").read_text().split("<h2>adt/scene1</h2>")
    assert "<td>own" not in means and "<td>own" in scenes
    assert "<td>55.0</td>" in means, "the mean of 50 and 60 percent"
    assert set(pd.read_csv(tmp_path / "tradeoff.csv").scene) == {"adt/scene1", "adt/scene2"}
    with pytest.raises(UserError, match="no variant in common"):
        run([variant(None), variant("draft", scene="scene2")], tmp_path)


def test_labels_of_points_in_one_place_do_not_overlap():
    figure, axes = plt.subplots(figsize=(6, 5))
    axes.set(xlim=(0.5, 1440), ylim=(0, 100), xscale="log")
    points = [(10.0 + 0.3 * number, 50.0 + 0.5 * number) for number in range(8)]
    place_labels(axes, {f"splats.iterations={number}": point for number, point in enumerate(points)})
    renderer, frame = figure.canvas.get_renderer(), axes.get_window_extent()
    boxes = [text.get_window_extent(renderer) for text in axes.texts if text.get_text()]
    assert len(boxes) == 8
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    assert all(frame.contains(*box.min) and frame.contains(*box.max) for box in boxes)
    plt.close(figure)
