"""From the scores of points to files."""

import json
from pathlib import Path

import pandas as pd
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.models.suitability import BRIEF, notice
from egosplat_rivals import commands
from egosplat_rivals.tradeoff.stage import run, run_scenes


@pytest.fixture
def page(three_points, tmp_path):
    """The files of three points."""
    run(three_points, tmp_path / "out")
    return tmp_path / "out"


def test_all_files_are_written_and_name_their_scene(page):
    document = json.loads((page / "tradeoff.json").read_text())
    assert [one["label"] for one in document["points"] if one["front"]] == [
        "the scene (balanced)",
        "splats.iterations=1500",
    ]
    assert (document["seeds"], document["origin"], document["confidence"]) == (3, "synthetic", 0.95)
    text = (page / "tradeoff.html").read_text()
    assert "snakemake --cores 2" in text and "<td>splats.iterations: 1500</td>" in text
    assert (
        "<title>Speed against accuracy: adt/scene1, synthetic apartments, small checkpoints</title>" in text
    )
    assert "splats.iterations=7000; preset=balanced" in text and "a processor, 2 cores" in text
    assert "splats.iterations=1500 ◆" in text and "paper_scaled ◆" not in text
    assert "data:image/webp;base64," in text and "several machines" not in text
    with Image.open(page / "tradeoff.png") as picture:
        assert picture.width > 1000


def test_small_checkpoints_on_a_real_recording_are_reported(three_points, tmp_path):
    told = notice("real", {"clip_checkpoint": "small"})
    for path in (path for point in three_points for path in point["metrics"]):
        content = json.loads(Path(path).read_text()) | {"origin": "real", "notice": told}
        Path(path).write_text(json.dumps(content))
    run(three_points, tmp_path / "out")
    assert json.loads((tmp_path / "out/tradeoff.json").read_text())["notice"] == told
    text = (tmp_path / "out/tradeoff.html").read_text()
    assert told in text and BRIEF in text[: text.index("</title>")]
    assert pd.read_csv(tmp_path / "out/tradeoff.csv").about.str.contains(BRIEF).all()


def test_the_table_holds_every_number(page):
    table = pd.read_csv(page / "tradeoff.csv")
    whole = table[table.stage.isna()].set_index(["point", "measure"])
    assert whole.loc[("splats.iterations=1500", "accuracy"), "mean"] == pytest.approx(0.4)
    assert whole.loc[("the scene (balanced)", "wall_s"), "mean"] == pytest.approx(601)
    assert (whole.low < whole["mean"]).sum() > 0 and (whole.runs == 3).all()
    stages = table[table.stage == "splats"].set_index(["point", "measure"])
    assert stages.loc[("paper_scaled", "wall_s"), "mean"] == pytest.approx(6000)
    assert set(table.about) == {"synthetic apartments, small checkpoints"}


def test_own_files_are_replaced(page, three_points):
    before = {file.name: file.stat().st_ino for file in page.iterdir()}
    run(three_points, page)
    after = {file.name: file.stat().st_ino for file in page.iterdir()}
    assert before.keys() == after.keys() and len(before) == 4
    assert all(before[name] != after[name] for name in before)


def test_the_same_inputs_make_the_same_bytes(page, three_points, tmp_path):
    run(three_points, tmp_path / "again")
    for file in page.iterdir():
        again = (tmp_path / "again" / file.name).read_bytes()
        if file.suffix == ".html":
            again = again.replace(b"/again/", b"/out/")
        assert again == file.read_bytes(), file.name


def test_the_scene_alone_and_one_run_are_a_page(point, tmp_path):
    run([point([("preset", "balanced")], [0.5], [10.0], scene=True)], tmp_path)
    text = (tmp_path / "tradeoff.html").read_text()
    assert "Each point was run once" in text
    assert "a random pixel 5.0 %, the middle of the picture 15.0 %." in text


def test_no_settings_give_a_page_without_a_front(point, tmp_path):
    nothing = {"count": 0, "categories": 0, "accuracy": None, "accuracy_interval": None}
    nothing |= {"mean_iou": None, "mean_iou_interval": None, "random_pixel": None, "middle_pixel": None}
    one = point([], [0.5], [10.0], scene=True, scores=dict.fromkeys(("static", "dynamic", "all"), nothing))
    run([one], tmp_path)
    (told,) = json.loads((tmp_path / "tradeoff.json").read_text())["points"]
    assert told["measures"]["accuracy"] is None and not told["front"]


def test_points_have_to_be_json(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["egosplat-rivals", "tradeoff", "--points", "{", "--output", "x"])
    with pytest.raises(SystemExit) as stop:
        commands.main()
    assert stop.value.code == 2 and "is not JSON" in capsys.readouterr().err


@pytest.fixture
def two_scenes(point, tmp_path):
    """tradeoff.json of two scenes; the second takes twice the time, and lacks the paper's settings."""
    files = []
    for place, factor in (("results/adt/scene1", 1.0), ("results/adt/scene2", 2.0)):
        points = [
            point([("preset", "balanced")], [0.5], [10.0 * factor], scene=True, place=place),
            point([("preset", "draft")], [0.4 + 0.1 * factor], [1.0 * factor], place=place),
        ]
        if factor == 1.0:
            points.append(point([("preset", "paper_scaled")], [0.9], [300.0], place=place))
        run(points, tmp_path / place / "tradeoff")
        files.append(tmp_path / place / "tradeoff/tradeoff.json")
    return files


def test_several_scenes_are_one_page_with_their_mean(two_scenes, tmp_path):
    """Points that one scene lacks have no mean, but stay in the table of the scene that has them."""
    run_scenes(two_scenes, tmp_path / "all")
    text = (tmp_path / "all/tradeoff.html").read_text()
    assert "<title>Speed against accuracy: adt/scene1, adt/scene2," in text
    means, scenes = text.split("<h2>adt/scene1</h2>")
    assert "<td>paper_scaled" not in means and "<td>paper_scaled" in scenes
    assert "<td>55.0</td>" in means, "the mean of 50 and 60 percent"
    table = pd.read_csv(tmp_path / "all/tradeoff.csv")
    assert set(table.scene) == {"adt/scene1", "adt/scene2"}
    assert not (tmp_path / "all/tradeoff.json").exists()


def test_a_file_that_is_no_trade_off_is_named(tmp_path):
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(UserError, match="other.json"):
        run_scenes([tmp_path / "other.json"], tmp_path / "all")
