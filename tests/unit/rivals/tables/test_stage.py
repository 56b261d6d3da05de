"""The stage ``tables``: from scores on disk to files."""

import base64
import io
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.evaluation.scored_scenes import one_line, read_scored_scene
from egosplat.models.suitability import BRIEF, notice
from egosplat.pipeline import validation
from egosplat_rivals.tables.stage import run
from tests.support.scores import OPTIONS

NAN = float("nan")
NAMES = ("adt_accuracy", "adt_iou", "adt_ablation", "hoi4d", "adt_transient")
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def least(part: dict, whole: dict):
    """The least document that a part of a schema allows."""
    if "$ref" in part:
        return least(whole["$defs"][part["$ref"].rpartition("/")[2]], whole)
    if "const" in part or "enum" in part:
        return part.get("const") or part["enum"][0]
    kind = part["type"] if isinstance(part["type"], str) else part["type"][-1]
    if kind == "object":
        return {key: least(part["properties"][key], whole) for key in part.get("required", ())}
    if kind == "array":
        return [least(part["items"], whole)] * part.get("minItems", 0)
    return {"string": "x", "integer": part.get("minimum"), "number": 0.0, "null": None, "boolean": False}[
        kind
    ]


def unpadded(path: Path) -> str:
    """A Markdown file with single spaces."""
    return re.sub(" +", " ", path.read_text())


def scores(accuracy: float, count: int = 100) -> dict:
    share = {
        "count": count,
        "accuracy": accuracy,
        "categories": 10,
        "accuracy_interval": [accuracy - 0.1, accuracy + 0.1],
        "mean_iou": accuracy / 2,
        "mean_iou_interval": [accuracy / 2 - 0.05, accuracy / 2 + 0.05],
        "random_pixel": 0.05,
        "middle_pixel": 0.15,
    }
    nothing = dict.fromkeys(share, None) | {"count": 0, "categories": 0}
    return {"static": share, "dynamic": nothing, "all": share}


def queries(accuracy: float, count: int = 100) -> list[dict]:
    """Rows that come to these scores: ten categories, those first in the alphabet found more often."""

    def result(number: int) -> dict:
        hit = {"hit": number < round(accuracy * count), "iou": accuracy / 2}
        return hit | {"random_hit": 0.05, "middle_hit": number % 20 < 3, "instances": ["Thing"]}

    return [
        {
            "frame": number % 10,
            "category": f"thing {number // 10}",
            "relevancy": 0.5,
            **dict.fromkeys(("level", "pixel", "position", "mask_level")),
            "mask_pixels": 0,
            "groups": {group: result(number) for group in ("static", "all")},
        }
        for number in range(count)
    ]


@pytest.fixture
def scored(tmp_path):
    """``scored(place, accuracy, ...)``: the path of scores below results."""

    def write(place, accuracy=0.5, origin="synthetic", checkpoint="small", options=None, **more) -> Path:
        schema = validation.schema("metrics")
        document = least(schema, schema)
        counts = schema["properties"]["counts"]["properties"]
        document["counts"] = {key: least(part, schema) for key, part in counts.items()}
        dataset, name, *below = place.split("/")
        document["presence"] = least(schema["properties"]["presence"], schema)
        document["length_unit"] = "m"
        title = f"{dataset}/{name}" + (f", {below[1]}" if below[:1] == ["variants"] else "")
        document |= {
            "scene": title,
            "origin": origin,
            "scores": scores(accuracy),
            "queries": queries(accuracy),
        }
        document["provenance"]["options"] = OPTIONS | (options or {})
        document["models"] = {
            "clip_checkpoint": {"checkpoint": checkpoint, "hash": "c0de" * 4, "small": checkpoint == "small"}
        }
        path = tmp_path / "results" / place / "metrics.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document | more))
        return path

    return write


@pytest.fixture
def tables(tmp_path):
    """``tables(*paths)``: the CSV files of the stage, by name."""

    def make(*paths, pictures=()) -> dict[str, pd.DataFrame]:
        run(paths, tmp_path / "out", pictures=pictures)
        return {
            name: pd.read_csv(tmp_path / "out" / f"{name}.csv", keep_default_na=False, na_values=[""])
            for name in NAMES
        }

    return make


def test_all_files_are_written_even_without_scores(tables, tmp_path):
    found = tables()
    expected = {f"{name}.{suffix}" for name in NAMES for suffix in ("csv", "md", "tex")} | {"tables.html"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == expected
    assert set(found["hoi4d"].kind) == {"printed", "real"}
    assert found["hoi4d"][found["hoi4d"].kind == "real"].percent.isna().all()
    assert "none yet" in (tmp_path / "out" / "tables.html").read_text()


def test_the_same_scores_make_the_same_bytes_in_any_order(tables, scored, tmp_path):
    paths = [scored("adt/scene1"), scored("adt/scene2", 0.3)]
    tables(*paths)
    first = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    tables(*reversed(paths))
    again = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert first == again


def test_a_scene_that_is_missing_is_left_out_of_the_average(tables, scored, tmp_path):
    found = tables(scored("adt/scene1", 0.4), scored("adt/scene3", 0.6))["adt_accuracy"]
    own = found[(found.kind == "synthetic") & (found.group == "static") & (found.method == "EgoSplat")]
    own = own.set_index("scene")
    assert own.percent.to_dict() == pytest.approx(
        {"scene1": 40, "scene2": NAN, "scene3": 60, "scene4": NAN, "scene5": NAN, "average": 50},
        nan_ok=True,
    )
    assert own.scenes["average"] == "scene1 scene3" and own.queries["average"] == 200
    assert (own.low["scene1"], own.high["scene1"]) == (30.0, 50.0)
    # Twenty categories, ten of them found in all of their frames: not the 43 to 57 of 200 independent queries.
    assert own.categories["average"] == 20
    assert own.low["average"] < 33 and 67 < own.high["average"]
    dynamic = found[(found.kind == "synthetic") & (found.group == "dynamic")]
    assert dynamic.percent.isna().all()
    text = unpadded(tmp_path / "out" / "adt_accuracy.md")
    assert "small checkpoints), average of 2 of 5 scenes | 40.0 | - | 40.0 | - | - | - | 60.0 |" in text


def test_synthetic_rows_are_separate(tables, scored, tmp_path):
    paths = [
        scored("adt/scene1", 0.89),
        scored("adt/scene1/methods/mine", 0.2, method="Mine", models={}),
        scored("adt/scene2", 0.5, "real", "/models/vit.bin"),
    ]
    found = tables(*paths)["adt_accuracy"]
    assert list(found.kind.unique()) == ["printed", "real", "synthetic"]
    assert set(found[found.kind == "synthetic"].data) == {"synthetic apartments"}
    assert set(found[found.kind != "synthetic"].data) == {"ADT"}
    averages = found[(found.scene == "average") & (found.group == "all") & (found.method == "EgoSplat")]
    averages = averages.set_index("kind")
    assert averages.percent["real"] == 50.0 and averages.percent["synthetic"] == 89.0
    for suffix in ("md", "tex"):
        text = (tmp_path / "out" / f"adt_accuracy.{suffix}").read_text()
        rows = [line for line in text.splitlines() if "89.0" in line]
        assert len(rows) == 1
        assert "EgoSplat (egosplat, synthetic apartments, small checkpoints)" in rows[0]
        assert not any(mark in rows[0] for mark in ("**", "bfseries"))
        before = text[: text.index(rows[0])]
        heading = before.rindex("synthetic apartments: not ADT")
        assert heading > max(before.rindex("(paper, ADT)"), before.rindex("(egosplat, ADT, checkpoints clip"))
        # The printed numbers are ranked as without it.
        assert ("**35.2**" if suffix == "md" else r"\bfseries \color[HTML]{C00000} 35.2") in text
    page = (tmp_path / "out" / "tables.html").read_text()
    assert "synthetic apartments, small checkpoints" in page[: page.index("</title>")]


def test_chance_stands_below_what_was_measured(tables, scored, tmp_path):
    """A random pixel and the middle of the picture, on the same scenes, in each format; of mIoU nothing."""
    found = tables(scored("adt/scene1", 0.9), scored("adt/scene2", 0.3))
    own = found["adt_accuracy"]
    own = own[(own.kind == "synthetic") & (own.group == "all")]
    chance = own[own.scene == "average"].set_index("method").percent.to_dict()
    measured = {name: percent for name, percent in chance.items() if not pd.isna(percent)}
    assert measured == {"EgoSplat": 60.0, "a random pixel": 5.0, "the middle of the picture": 15.0}
    assert own[(own.method == "a random pixel") & (own.scene == "scene1")].percent.tolist() == [5.0]
    assert "a random pixel" not in set(found["adt_iou"].method)
    ablation = found["adt_ablation"]
    assert (
        ablation[(ablation.method == "a random pixel") & (ablation.metric == "mean_iou")].percent.isna().all()
    )
    for suffix in ("md", "tex"):
        text = (tmp_path / "out" / f"adt_accuracy.{suffix}").read_text()
        assert "Chance: the middle of the picture (synthetic apartments), average of 2 of 5 scenes" in text
    assert "Chance: a random pixel" in (tmp_path / "out" / "tables.html").read_text()


def test_validation_apartments_stand_apart(tables, scored, tmp_path):
    """scene6 to scene10 are in no average of the apartments that defaults were chosen by, nor these in theirs."""
    found = tables(scored("adt/scene1", 0.9), scored("adt/scene6", 0.4), scored("adt/scene7", 0.2))
    own = found["adt_accuracy"]
    own = own[(own.kind == "synthetic") & (own.group == "all") & (own.method == "EgoSplat")]
    averages = own[own.scene == "average"].set_index("data")
    assert averages.percent.to_dict() == pytest.approx(
        {"synthetic apartments": 90.0, "validation apartments": 30.0}
    )
    assert averages.scenes["validation apartments"] == "scene6 scene7"
    assert own[own.data == "validation apartments"].percent.count() == 1
    transient = found["adt_transient"]
    assert "validation apartments" not in set(transient.data)
    text = (tmp_path / "out" / "adt_accuracy.md").read_text()
    assert "validation apartments (scene6 to scene10): not ADT" in text


def test_small_checkpoints_on_real_data_are_marked_in_every_format(tables, scored, tmp_path):
    told = notice("real", {"clip_checkpoint": "small"})
    paths = [scored("adt/scene1", 0.77, "real", notice=told), scored("adt/scene2", 0.66, "real", "/a.bin")]
    found = tables(*paths)["adt_accuracy"]
    own = found[found.kind == "real"].drop_duplicates("checkpoints").set_index("checkpoints")
    assert own.notice["small checkpoints"] == told and pd.isna(own.notice["checkpoints clip a.bin"])
    for suffix in ("md", "tex"):
        text = (tmp_path / "out" / f"adt_accuracy.{suffix}").read_text()
        labels = {
            score: next(line for line in text.splitlines() if score in line) for score in ("77.0", "66.0")
        }
        assert BRIEF in labels["77.0"] and BRIEF not in labels["66.0"]
        assert "models.set" in text
    page = (tmp_path / "out" / "tables.html").read_text()
    assert BRIEF in page[: page.index("</title>")] and told[1:] in page


def test_the_page_shows_the_alarms_of_its_scenes(tables, scored, tmp_path):
    alarm = {"key": "poses.models", "figures": {"value": 2, "limit": 1, "frames": "<4>, 7"}}
    tables(scored("adt/scene1", alarms=[alarm]), scored("adt/scene2"))
    page = (tmp_path / "out" / "tables.html").read_text()
    section = page[page.index('id="alarms"') :]
    assert "adt/scene1" in section and "adt/scene2" not in section
    assert all(word in section for word in ("poses.models", "&lt;4&gt;, 7", "up to 1", "log of poses"))
    tables(scored("adt/scene1"))
    assert 'id="alarms"' not in (tmp_path / "out" / "tables.html").read_text()


def test_answers_to_what_is_not_there_stand_beside_the_accuracy(scored, tables, tmp_path):
    """The counts of scenes are summed in a note below the table."""
    counts = {
        "present": {"asked": 20, "answered": 9, "right": 8, "unverified": 1, "guessed": 4, "guessed_right": 3}
    }
    counts |= {"absent": {"asked": 30, "answered": 2, "untaught": 10, "guessed": 5}}
    presence = counts | {"min_score": 0.5, "separation": 0.9, "queries": []}
    tables(scored("adt/scene1", presence=presence), scored("adt/scene2", presence=presence))
    page = (tmp_path / "out" / "adt_accuracy.md").read_text()
    assert "18 of 40 present things are found, 16 of them correctly, and 4 of 60 absent things" in page
    assert "best guesses are right for 6 more" in page
    assert "that are not there" not in (tmp_path / "out" / "adt_iou.md").read_text()


def test_scenes_with_other_models_are_not_averaged_together(tables, scored):
    paths = [scored("adt/scene1", 0.4, "real", "a.bin"), scored("adt/scene2", 0.6, "real", "b.bin")]
    found = tables(*paths)["adt_accuracy"]
    own = found[(found.kind == "real") & (found.scene == "average") & (found.group == "all")]
    own = own[own.method == "EgoSplat"]
    assert own.percent.tolist() == [40.0, 60.0]
    assert own.checkpoints.tolist() == ["checkpoints clip a.bin", "checkpoints clip b.bin"]


def test_models_with_one_name_are_distinguished_by_hash(tables, scored):
    models = {"clip_checkpoint": {"checkpoint": "/x/a.bin", "hash": "beef" * 4, "small": False}}
    paths = [scored("adt/scene1", 0.4, "real", "/y/a.bin"), scored("adt/scene2", 0.6, "real", models=models)]
    found = tables(*paths)["adt_accuracy"]
    names = sorted(found[found.kind == "real"].checkpoints.dropna().unique())
    assert names == ["checkpoints clip a.bin beefbeef", "checkpoints clip a.bin c0dec0de"]


def test_the_ablations_take_their_variants(tables, scored):
    paths = [scored("adt/scene1", 0.9)] + [
        scored(f"adt/scene1/variants/{name}", accuracy)
        for name, accuracy in (("no_masks", 0.7), ("network_masks", 0.8))
    ]
    found = tables(*paths)
    lines = {}
    for name in ("adt_ablation", "adt_transient"):
        one = found[name]
        one = one[(one.kind == "synthetic") & (one.metric == "accuracy") & (one.group == "all")]
        one = one[one.method == "EgoSplat"]
        lines[name] = list(zip(one.variant, one.percent.fillna(-1), strict=True))
    assert lines["adt_ablation"] == [("baseline", -1), ("no_masks", 70.0), ("full", 90.0)]
    assert lines["adt_transient"] == [("no_masks", 70.0), ("network_masks", 80.0), ("full", 90.0)]
    # By scene, only what the scene's own folder holds.
    by_scene = found["adt_accuracy"]
    own = by_scene[(by_scene.kind == "synthetic") & (by_scene.method == "EgoSplat")]
    assert own.percent.dropna().unique().tolist() == [90.0]


def test_averages_over_different_scenes_are_marked(tables, scored, tmp_path):
    tables(scored("adt/scene1"), scored("adt/scene2"), scored("adt/scene1/variants/baseline"))
    text = (tmp_path / "out" / "adt_ablation.md").read_text()
    assert "Averages on synthetic apartments are over different scenes" in text
    tables(scored("adt/scene1"), scored("adt/scene1/variants/baseline"))
    assert "over different scenes" not in (tmp_path / "out" / "adt_ablation.md").read_text()


def test_another_method_has_a_row_of_its_name(tables, scored, tmp_path):
    hostile = "My\nmethod <b>&_"
    paths = [
        scored("adt/scene1", 0.5, "real", "a.bin"),
        scored("adt/scene1/methods/mine", 0.3, "real", method=hostile, models={}),
    ]
    found = tables(*paths)
    by_scene = found["adt_accuracy"]
    assert list(by_scene[by_scene.kind == "real"].method.unique())[5:7] == ["EgoSplat", "My method <b>&_"]
    assert "My method" not in (tmp_path / "out" / "adt_ablation.md").read_text()
    assert (
        r"My method \textless{}b\textgreater{}\&\_ (scored by egosplat, ADT)"
        in (tmp_path / "out" / "adt_accuracy.tex").read_text()
    )
    page = (tmp_path / "out" / "tables.html").read_text()
    assert "My method &lt;b&gt;&amp;_ (scored by egosplat, ADT)" in page and "<b>" not in page


MADE = {
    f"{name}.zarr": {"cpu_s": seconds, "peak_memory_mb": megabytes}
    for name, seconds, megabytes in (
        ("annotations", 6000, 9000),
        ("frames", 30, 512),
        ("splats", 240, 1024),
        ("language", 60, 2048),
    )
}


def own_run(schema: str = "metrics") -> dict:
    """Entries of a method that egosplat ran itself."""
    whole = validation.schema(schema)
    made = least(whole["$defs"]["provenance"], whole)
    artifacts = {name: made | {"digest": "d"} | cost for name, cost in MADE.items()}
    return {"provenance": made | {"stage": "metrics", "options": OPTIONS}, "artifacts": artifacts}


def test_methods_stand_in_the_paper_s_order_and_missing_ones_say_so(tables, scored, tmp_path):
    """With their cost, and footnotes on what stands in for parts of them."""
    more = own_run()
    scored_as = {
        "langsplat": ("LangSplat", 0.4, ["SAM2 in place of SAM", "3,000 of 30,000 iterations"]),
        "occam": ("Occam's LGS", 0.6, ["SAM2 in place of SAM"]),
        "gags": ("GAGS", 0.2, []),
    }
    paths = [
        scored(f"adt/scene1/variants/{name}", accuracy, method=method, stands_in=told, **more)
        for name, (method, accuracy, told) in scored_as.items()
    ]
    found = tables(*paths, scored("adt/scene1", 0.7, stands_in=["SAM2 in place of SAM"], **more))
    rows = found["adt_accuracy"]
    rows = rows[(rows.kind == "synthetic") & (rows.scene == "scene1") & (rows.group == "all")]
    assert list(rows.method)[:7] == [
        "LERF",
        "LEGaussian",
        "SG",
        "GAGS",
        "LangSplat",
        "EgoSplat",
        "Occam's LGS",
    ]
    assert rows.percent.tolist()[3:7] == [20.0, 40.0, 70.0, 60.0] and rows.percent[:3].isna().all()
    assert rows.cpu_min.tolist()[4:7] == [5.5] * 3 and rows.memory_gib.tolist()[4:7] == [2.0] * 3
    assert rows.stands_in.tolist()[3:7] == pytest.approx(
        [NAN, "SAM2 in place of SAM; 3,000 of 30,000 iterations", NAN, "SAM2 in place of SAM"], nan_ok=True
    )
    text = unpadded(tmp_path / "out" / "adt_iou.md")
    label = "LangSplat (reimplemented by egosplat, synthetic apartments, small checkpoints), average of 1 of 5 scenes"
    assert f"| {label} \\[c,d\\] |" in text and "LERF (synthetic apartments: not measured)" in text
    assert "- \\[c\\] SAM2 in place of SAM." in text and "CPU min | a scene GiB |" in text
    assert "EgoSplat (egosplat, synthetic apartments, small checkpoints), average of 1 of 5 scenes |" in text
    page = (tmp_path / "out" / "tables.html").read_text()
    assert f"{label} [d,e]<" in page and ">CPU min</th>" in page
    assert "LangSplat (reimplemented" not in (tmp_path / "out" / "adt_ablation.md").read_text()
    tex = (tmp_path / "out" / "adt_accuracy.tex").read_text()
    assert r"& CPU min & GiB \\" in tex and "[d,e] &" in tex


def test_a_cost_with_a_lost_artifact_is_not_told(tables, scored):
    more = own_run()
    more["artifacts"]["splats.zarr"] = None
    rows = tables(scored("adt/scene1", 0.7, **more))["adt_accuracy"]
    assert rows.cpu_min.isna().all()


def test_maps_of_a_method_of_the_paper_stand_in_its_row(tables, scored):
    rows = tables(scored("adt/scene1/methods/lerf", 0.3, method="LERF", models={}))["adt_accuracy"]
    rows = rows[(rows.kind == "synthetic") & (rows.scene == "scene1") & (rows.group == "all")]
    assert rows.method.tolist()[0] == "LERF" and rows.percent.tolist()[0] == 30.0


def test_scores_from_another_folder_keep_their_scene_name(scored, tmp_path):
    path = tmp_path / "elsewhere.json"
    path.write_text(scored("hoi4d/scene2").read_text())
    found = read_scored_scene(path)
    assert (found.dataset, found.scene, found.variant) == ("hoi4d", "scene2", "full")
    path.write_text(scored("adt/scene1/variants/network_masks").read_text())
    assert read_scored_scene(path).variant == "network_masks"
    path.write_text(path.read_text().replace("adt/scene1, network_masks", "kitchen"))
    with pytest.raises(UserError, match="elsewhere.json"):
        read_scored_scene(path)


def test_scores_in_the_folder_of_another_scene_are_rejected(scored):
    with pytest.raises(UserError, match="adt/scene2"):
        read_scored_scene(scored("adt/scene1", scene="adt/scene2"))
    with pytest.raises(UserError, match="adt/scene1, baseline"):
        read_scored_scene(scored("adt/scene1", scene="adt/scene1, baseline"))
    assert read_scored_scene(scored("adt/scene1", scene="scene")).scene == "scene1"


def test_scores_without_a_table_are_reported(tables, scored, capsys):
    found = tables(
        scored("plain/room"), scored("adt/scene9", origin="real"), scored("adt/scene2/variants/network_masks")
    )
    told = capsys.readouterr().err
    for place in (
        "plain/room, variant full",
        "adt/scene9, variant full",
        "adt/scene2, variant network_masks",
    ):
        assert f"no table shows {place}" in told
    assert not any("synthetic" in set(table.kind) for table in found.values())


@pytest.mark.parametrize("key, value", [("hit_region", "mask"), ("people", True)])
def test_scores_with_different_options_are_rejected(tables, scored, key, value):
    paths = [scored("adt/scene1"), scored("adt/scene2", options={key: value})]
    with pytest.raises(UserError, match=f"scene2/metrics.json.* metrics.{key} = .?{value}"):
        tables(*paths)


def test_datasets_may_differ_in_options(tables, scored):
    tables(scored("adt/scene1"), scored("hoi4d/scene1", options={"hit_region": "mask"}))


def test_duplicate_scores_are_rejected(tables, scored):
    with pytest.raises(UserError, match="the same"):
        tables(scored("adt/scene1"), scored("adt/scene1"))


@pytest.mark.parametrize(
    "content, message",
    [
        ("{", "cannot be read as JSON"),
        ('{"scene": NaN}', "NaN is no number of JSON"),
        ("{}", "is not allowed"),
        ("\udcff", None),
    ],
)
def test_a_file_without_scores_is_named(tables, tmp_path, content, message):
    path = tmp_path / "metrics.json"
    path.write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(UserError, match=f"metrics.json: .*{message or ''}"):
        tables(path)
    with pytest.raises(UserError, match="absent.json"):
        tables(tmp_path / "absent.json")
    assert not (tmp_path / "out").exists()


def test_scores_of_an_older_format_are_named_with_what_to_do(tables, scored):
    """Those of format 1 have intervals over queries."""
    with pytest.raises(UserError, match="scene1/metrics.json.* 1; .* 6") as caught:
        tables(scored("adt/scene1", format_version=1))
    assert "--force" in str(caught.value) and str(caught.value).count("\n") == 1


def test_pictures_are_on_the_page(tables, tmp_path):
    picture = tmp_path / "results" / "adt" / "scene1" / "splats.png"
    picture.parent.mkdir(parents=True)
    Image.new("RGB", (4, 4), (200, 30, 10)).save(picture)
    tables(pictures=[picture])
    page = (tmp_path / "out" / "tables.html").read_text()
    content = base64.b64decode(page.split("data:image/webp;base64,")[1].split('"')[0])
    shown = np.asarray(Image.open(io.BytesIO(content)).convert("RGB"), int)
    assert np.abs(shown - (200, 30, 10)).max() <= 4, "WebP is not exact"
    assert "<figcaption>adt/scene1/splats.png</figcaption>" in page
    (tmp_path / "b.png").write_bytes(PIXEL[:30])
    for path, message in (
        ("a.svg", "is not an image for the page"),
        ("a.png", "does not exist"),
        ("b.png", "b.png: not a readable image .* Delete it and make it again"),
    ):
        with pytest.raises(UserError, match=message):
            tables(pictures=[tmp_path / path])


def test_names_are_put_on_one_line():
    assert one_line(" a\n\tb\x00c\u202ed ") == "a b c d"
