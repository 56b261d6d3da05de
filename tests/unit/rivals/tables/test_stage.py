"""The stage ``tables``: from scores on disk to files."""

import base64
import html
import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.models.suitability import BRIEF, notice
from egosplat_rivals.scored_scenes import read_scored_scene
from egosplat_rivals.tables.stage import run

NAN = float("nan")
NAMES = ("adt_accuracy", "adt_iou", "adt_ablation", "hoi4d", "adt_transient")


def section(out: Path, name: str) -> str:
    """The text of a table and its notes on the page."""
    text = (out / "tables.html").read_text().split(f'id="{name}"')[1].split("</section")[0]
    return " ".join(html.unescape(re.sub("<style.*?</style>|<[^>]*>", " ", text, flags=re.DOTALL)).split())


@pytest.fixture
def out(tmp_path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def tables(out):
    """``tables(*paths)``: the CSV files of the stage, by name."""

    def make(*paths, pictures=()) -> dict[str, pd.DataFrame]:
        run(paths, out, pictures=pictures)
        return {
            name: pd.read_csv(out / f"{name}.csv", keep_default_na=False, na_values=[""]) for name in NAMES
        }

    return make


def rows_of(table: pd.DataFrame, **values: str) -> pd.DataFrame:
    return table[(table[list(values)] == pd.Series(values)).all(axis=1)]


def test_all_files_are_written_even_without_scores_and_equally_in_any_order(tables, scored, out):
    found = tables()
    expected = {f"{name}.csv" for name in NAMES} | {"tables.html"}
    assert {path.name for path in out.iterdir()} == expected
    assert set(found["hoi4d"].kind) == {"printed", "real"}
    assert rows_of(found["hoi4d"], kind="real").percent.isna().all()
    assert "none yet" in (out / "tables.html").read_text()
    paths = [scored("adt/scene1"), scored("adt/scene2", 0.3)]
    tables(*paths)
    first = {path: path.read_bytes() for path in out.iterdir()}
    tables(*reversed(paths))
    assert first == {path: path.read_bytes() for path in out.iterdir()}


def test_recordings_apartments_and_validation_apartments_stand_apart(tables, scored, out):
    told = notice("real", {"clip_checkpoint": "small"})
    found = tables(
        *(scored(f"adt/scene{number}", score) for number, score in ((1, 0.4), (3, 0.6), (6, 0.4), (7, 0.2))),
        scored("adt/scene1/variants/mine", 0.2, method="Mine"),
        scored("adt/scene2", 0.66, "real", "/models/vit.bin"),
        scored("adt/scene4", 0.77, "real", notice=told),
    )
    table = found["adt_accuracy"]
    assert list(table.kind.unique()) == ["printed", "real", "synthetic"]
    assert set(table[table.kind != "synthetic"].data) == {"ADT"}
    own = rows_of(table, data="synthetic apartments", group="static", method="EgoSplat").set_index("scene")
    assert own.percent.dropna().to_dict() == pytest.approx({"scene1": 40, "scene3": 60, "average": 50})
    assert own.scenes["average"] == "scene1 scene3" and own.queries["average"] == 200
    assert (own.low["scene1"], own.high["scene1"]) == (30.0, 50.0)
    # Twenty categories, ten of them found in all of their frames: not the 43 to 57 of 200 independent queries.
    assert own.categories["average"] == 20
    assert own.low["average"] < 33 and 67 < own.high["average"]
    assert rows_of(table, kind="synthetic", group="dynamic").percent.isna().all()
    own = rows_of(table, data="validation apartments", group="all", method="EgoSplat")
    assert own.percent.dropna().tolist() == pytest.approx([30.0])
    assert own.scenes.dropna().tolist() == ["scene6 scene7"]
    assert "validation apartments" not in set(found["adt_transient"].data)
    own = rows_of(table, kind="real", scene="average", group="all", method="EgoSplat").set_index(
        "checkpoints"
    )
    assert own.percent["checkpoints clip vit.bin"] == 66.0 and own.percent["small checkpoints"] == 77.0
    assert pd.isna(own.notice["checkpoints clip vit.bin"]) and own.notice["small checkpoints"] == told
    text, page = section(out, "adt_accuracy"), (out / "tables.html").read_text()
    label = "EgoSplat (egosplat, synthetic apartments, small checkpoints), average of 2 of 5 scenes"
    assert re.search(rf"{re.escape(label)} 40.0 \S+ - 40.0 \S+ - - - 60.0 ", text)
    heading = text.index("synthetic apartments: not ADT")
    assert (
        max(text.rindex("(paper, ADT)"), text.rindex("(egosplat, ADT, checkpoints"))
        < heading
        < text.index(label)
    )
    assert BRIEF in text[text.index(" 66.0") : text.index(" 77.0")] and "models.set" in text
    assert BRIEF not in text[: text.index(" 66.0")]
    assert BRIEF in page[: page.index("</title>")] and told[1:] in page
    # The chance level, on the same scenes; of mIoU nothing.
    own = rows_of(table, data="synthetic apartments", group="all", scene="average").set_index("method")
    assert (own.percent["a random pixel"], own.percent["the middle of the picture"]) == (5.0, 15.0)
    assert "a random pixel" not in set(found["adt_iou"].method)
    chance = rows_of(found["adt_ablation"], method="a random pixel", metric="mean_iou")
    assert chance.percent.isna().all() and len(chance)


def test_the_page_shows_the_alarms_of_its_scenes(tables, scored, out):
    alarm = {"key": "poses.models", "figures": {"value": 2, "limit": 1, "frames": "<4>, 7"}}
    told = {"value": 12, "limit": 20, "advice": "Look.", "made_with": "9"}
    alarms = [alarm, {"key": "splats.psnr", "figures": told}]
    tables(scored("adt/scene1", alarms=alarms), scored("adt/scene2"))
    page = (out / "tables.html").read_text()
    section = page[page.index('id="alarms"') :]
    assert "adt/scene1" in section and "adt/scene2" not in section
    assert all(one in section for one in ("poses.models", "&lt;4&gt;, 7", "up to 1", "Made with 9. Look."))
    tables(scored("adt/scene1"))
    assert 'id="alarms"' not in (out / "tables.html").read_text()


def test_answers_to_what_is_not_there_stand_beside_the_accuracy(scored, tables, out):
    present = {"asked": 20, "answered": 9, "right": 8, "unverified": 1, "guessed": 4, "guessed_right": 3}
    absent = {"asked": 30, "answered": 2, "untaught": 10, "guessed": 5}
    presence = {"present": present, "absent": absent, "min_score": 0.5, "separation": 0.9, "queries": []}
    tables(scored("adt/scene1", presence=presence), scored("adt/scene2", presence=presence))
    page = section(out, "adt_accuracy")
    assert "18 of 40 present things are found, 16 of them correctly, and 4 of 60 absent things" in page
    assert "best guesses are right for 6 more" in page
    assert "absent things" not in section(out, "adt_iou")


@pytest.mark.parametrize(
    "first, second, names",
    [
        (("a.bin", "c0de"), ("b.bin", "c0de"), ["a.bin", "b.bin"]),
        (("/x/a.bin", "c0de"), ("/y/a.bin", "beef"), ["a.bin c0dec0de", "a.bin beefbeef"]),
    ],
)
def test_scenes_with_other_models_are_not_averaged_together(tables, scored, first, second, names):
    models = [
        {"clip_checkpoint": {"checkpoint": name, "hash": code * 4, "small": False}}
        for name, code in (first, second)
    ]
    paths = [
        scored("adt/scene1", 0.4, "real", models=models[0]),
        scored("adt/scene2", 0.6, "real", models=models[1]),
    ]
    found = tables(*paths)["adt_accuracy"]
    own = rows_of(found, kind="real", scene="average", group="all", method="EgoSplat")
    expected = {f"checkpoints clip {name}": percent for name, percent in zip(names, (40, 60), strict=True)}
    assert dict(zip(own.checkpoints, own.percent, strict=True)) == expected


def test_the_ablations_take_their_variants_and_mark_averages_over_different_scenes(tables, scored, out):
    places = {"scene1": 0.9, "scene1/variants/network_masks": 0.8, "scene1/variants/no_masks": 0.7}
    paths = [scored(f"adt/{place}", accuracy) for place, accuracy in places.items()]
    found = tables(*paths)
    lines = {}
    for name in ("adt_ablation", "adt_transient"):
        own = rows_of(found[name], kind="synthetic", metric="accuracy", group="all", method="EgoSplat")
        lines[name] = list(zip(own.variant, own.percent.fillna(-1), strict=True))
    assert lines["adt_ablation"] == [("baseline", -1), ("no_masks", 70.0), ("full", 90.0)]
    assert lines["adt_transient"] == [("no_masks", 70.0), ("network_masks", 80.0), ("full", 90.0)]
    # By scene, only what the scene's own folder holds.
    own = rows_of(found["adt_accuracy"], kind="synthetic", method="EgoSplat")
    assert own.percent.dropna().unique().tolist() == [90.0]
    told = "Averages on synthetic apartments are over different scenes"
    assert told not in section(out, "adt_ablation")
    tables(*paths, scored("adt/scene2"))
    assert told in section(out, "adt_ablation")


def test_methods_stand_in_the_paper_s_order_and_missing_ones_say_so(tables, scored, made, out):
    costs = {
        "annotations": {"cpu_s": 6000, "peak_memory_mb": 9000},
        "frames": {"cpu_s": 30, "peak_memory_mb": 512},
        "language": {"cpu_s": 300, "peak_memory_mb": 2048},
    }
    scored_as = {
        "langsplat": ("LangSplat", 0.4, ["SAM2 in place of SAM", "3,000 of 30,000 iterations"]),
        "mine": ("My\nmethod\x00\u202e <b>&_", 0.6, ["SAM2 in place of SAM"]),
        "gags": ("GAGS", 0.2, []),
    }
    paths = [
        scored(f"adt/scene1/variants/{name}", accuracy, method=method, stands_in=told, **made(**costs))
        for name, (method, accuracy, told) in scored_as.items()
    ]
    paths.append(scored("adt/scene1", 0.7, stands_in=["SAM2 in place of SAM"], **made(**costs)))
    lost = made(frames={"cpu_s": 30})
    lost["artifacts"]["splats.zarr"] = None
    paths.append(scored("adt/scene1/variants/lerf", 0.1, method="LERF", **lost))
    found = rows_of(tables(*paths)["adt_accuracy"], kind="synthetic", scene="scene1", group="all")
    rows = found.reset_index()[:7]
    names = ["LERF", "LEGaussian", "SG", "GAGS", "LangSplat", "EgoSplat", "My method <b>&_"]
    assert rows.method.tolist() == names
    assert rows.percent.tolist() == pytest.approx([10.0, NAN, NAN, 20.0, 40.0, 70.0, 60.0], nan_ok=True)
    assert rows.cpu_min.tolist() == pytest.approx([NAN] * 3 + [5.5] * 4, nan_ok=True)
    assert rows.memory_gib.tolist() == pytest.approx([NAN] * 3 + [2.0] * 4, nan_ok=True)
    told = ["SAM2 in place of SAM; 3,000 of 30,000 iterations", NAN, "SAM2 in place of SAM"]
    assert rows.stands_in.tolist()[4:] == pytest.approx(told, nan_ok=True)
    text, page = section(out, "adt_iou"), (out / "tables.html").read_text()
    label = "LangSplat (reimplemented by egosplat, synthetic apartments, small checkpoints), average of 1 of 5 scenes"
    assert f"{label} [c,d] " in text and "SG (synthetic apartments: not measured)" in text
    assert "[c] SAM2 in place of SAM." in text
    assert f"{label} [d,e]<" in page and ">CPU min</th>" in page and "<b>" not in page
    assert "LangSplat (reimplemented" not in section(out, "adt_ablation")


def test_what_is_asked_in_several_ways_has_a_row_for_each(tables, scored, out):
    ways = {"": ("gaussians", 0.25), "no_sizes": ("gaussians", 0.0), "pixels": ("pixels", 0.25)}
    paths, method = [], {"method": "Occam's LGS"}
    for name, values in ways.items():
        keys = {"options": dict(zip(("readout", "size_weight"), values, strict=True))}
        paths += [scored(f"adt/scene1{name and '/variants/'}{name}", 0.6, **keys)]
        paths += [scored(f"adt/scene1/variants/occam_{name}", 0.4, **keys, **method)]
    found = rows_of(tables(*paths)["adt_iou"], kind="synthetic", scene="scene1", group="all")
    rows = [row for row in zip(found.method, found.readout, found.percent, strict=True) if row[2] > 0]
    theirs = [("Occam's LGS", way, 20) for way, _ in ways.values()]
    assert rows == [("EgoSplat", "sizes", 30), *(("EgoSplat", way, 30) for _, way, _ in theirs[1:]), *theirs]
    text = section(out, "adt_iou")
    assert text.count(", asked with sizes)") == 1
    assert text.count(", asked by pixels)") == 2 and " Rows asked by pixels" in text
    assert "by pixels" not in section(out, "adt_ablation")


def test_scores_are_of_their_folder_s_scene_and_elsewhere_of_the_one_that_they_name(scored, tmp_path):
    path = tmp_path / "elsewhere.json"
    for place, names in (
        ("hoi4d/scene2", ("hoi4d", "scene2", "full")),
        ("adt/scene1/variants/network_masks", ("adt", "scene1", "network_masks")),
    ):
        path.write_text(scored(place).read_text())
        found = read_scored_scene(path)
        assert (found.dataset, found.scene, found.variant) == names
    path.write_text(path.read_text().replace("adt/scene1, network_masks", "kitchen"))
    with pytest.raises(UserError, match="elsewhere.json"):
        read_scored_scene(path)
    for other in ("adt/scene2", "adt/scene1, baseline"):
        with pytest.raises(UserError, match=other):
            read_scored_scene(scored("adt/scene1", scene=other))
    assert read_scored_scene(scored("adt/scene1", scene="scene")).scene == "scene1"


def test_scores_without_a_table_are_reported_and_tables_have_one_protocol_and_a_scene_one_file(
    tables, scored, capsys
):
    real = scored("adt/scene9", origin="real")
    found = tables(scored("plain/room"), real, scored("adt/scene2/variants/network_masks"))
    told = capsys.readouterr().err
    assert all(f"no table shows {place}" in told for place in ("plain/room", "adt/scene9", "adt/scene2"))
    assert not any("synthetic" in set(table.kind) for table in found.values())
    first = scored("adt/scene1")
    tables(first, scored("hoi4d/scene1", options={"masks": "classes"}))
    for key, value in (("masks", "classes"), ("held_out", "given")):
        with pytest.raises(UserError, match=f"scene2/metrics.json.* metrics.{key} = .?{value}"):
            tables(first, scored("adt/scene2", options={key: value}))
    with pytest.raises(UserError, match="the same"):
        tables(first, first)


def test_a_file_without_scores_is_named(tables, tmp_path, out):
    path = tmp_path / "metrics.json"
    for content in ("{", "{}"):
        path.write_text(content)
        with pytest.raises(UserError, match="metrics.json: .*"):
            tables(path)
    with pytest.raises(UserError, match="absent.json"):
        tables(tmp_path / "absent.json")
    assert not out.exists()


def test_pictures_are_on_the_page(tables, tmp_path, out):
    picture = tmp_path / "results" / "adt" / "scene1" / "splats.png"
    picture.parent.mkdir(parents=True)
    Image.new("RGB", (4, 4), (200, 30, 10)).save(picture)
    tables(pictures=[picture])
    page = (out / "tables.html").read_text()
    content = base64.b64decode(page.split("data:image/webp;base64,")[1].split('"')[0])
    shown = np.asarray(Image.open(io.BytesIO(content)).convert("RGB"), int)
    assert np.abs(shown - (200, 30, 10)).max() <= 4, "WebP is not exact"
    assert "<figcaption>adt/scene1/splats.png</figcaption>" in page
    (tmp_path / "b.png").write_bytes(picture.read_bytes()[:30])
    for name in ("a.svg", "a.png", "b.png"):
        with pytest.raises(UserError, match=name):
            tables(pictures=[tmp_path / name])
