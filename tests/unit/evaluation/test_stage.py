"""The stage ``metrics`` on a scene whose answers are known."""

import json
import math
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from jsonschema import ValidationError

from egosplat.artifacts import provenance
from egosplat.artifacts.lineage import check_tree
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FEATURES, FRAMES, LANGUAGE
from egosplat.errors import UserError
from egosplat.evaluation.document import finite
from egosplat.evaluation.evaluation_frames import SCORED, read_evaluation
from egosplat.evaluation.scores import ask_of
from egosplat.models.suitability import notice
from egosplat.pipeline.validation import write_document
from egosplat.query import finished_scene
from tests.support.scenes import put
from tests.unit.evaluation.conftest import ARTIFACTS, score


def scored(*given, **keys):
    return json.loads(score(*given, **keys).read_text())


@pytest.fixture(scope="module")
def usual(word_scene_in, tmp_path_factory):
    """``scored(word_scene())``."""
    return scored(word_scene_in(tmp_path_factory.mktemp("usual")))


def test_maps_from_tiles_are_scored_by_pixels_and_without_features(word_scene, usual):
    """Protects the text encoder, which is then that of the tiles, and the decoder, that of language.zarr."""
    folder = word_scene()
    language = open_artifact(folder / "language.zarr", LANGUAGE)
    clip = open_artifact(folder / "features.zarr", FEATURES).facts["clip"]
    arrays = {name: language.read(name) for name in ("code", "share")}
    channels, count = arrays["code"].shape[2], len(arrays["code"])
    arrays["decoder/values"] = np.zeros(0, np.float32)
    facts = language.facts | {"decoder": {"widths": [channels]}, "method": "field", "maps_only": True}
    by_pixels = scored(folder, readout="pixels")
    for name in ("features", "language"):
        shutil.rmtree(folder / f"{name}.zarr")
    put(folder, "tiles", {}, {"clip": clip}, made_from=["frames"])
    put(folder, "language", arrays, facts, made_from=["frames", "poses", "tiles", "splats"])
    names = [name for name in ARTIFACTS if name != "features"]
    found = scored(folder, [*names, "tiles"], {"method": "LERF"})
    assert found["queries"] == by_pixels["queries"] != usual["queries"] and "views" not in found["counts"]
    assert found["provenance"]["options"]["readout"] == "pixels" and found["counts"]["gaussians"] == count
    assert set(found["artifacts"]) == {f"{name}.zarr" for name in (*names, "tiles")}
    assert not found["presence"]["queries"] and by_pixels["presence"]["queries"]
    with pytest.raises(UserError, match="--frame"):
        finished_scene.open_scene(folder, device="cpu").ask("couch")
    with pytest.raises(UserError, match="give --features or --tiles"):
        score(folder, names)


@pytest.mark.parametrize("readout", ["gaussians", "pixels"])
def test_equal_codes_answer_alike_by_whatever_method(word_scene, usual, readout):
    folder = word_scene()
    language = open_artifact(folder / "language.zarr", LANGUAGE)
    arrays, facts = {name: language.read(name) for name in ("code", "share")}, language.facts
    before = scored(folder, readout=readout)
    shutil.rmtree(folder / "language.zarr")
    made_from = ["frames", "poses", "features", "splats"]
    put(folder, "language", arrays, facts | {"method": "center"}, made_from=made_from)
    found = scored(folder, told={"method": "Occam's LGS"}, readout=readout)
    assert found["queries"] == before["queries"] and found["provenance"]["options"]["readout"] == readout
    assert (found["queries"] == usual["queries"]) == (readout == "gaussians")


def test_with_the_words_exchanged_every_answer_is_wrong(word_scene, monkeypatch):
    """Protects the scores from annotations that leak into answers."""
    encode = finished_scene.encode_texts

    def exchanged(*given):
        texts = encode(*given)
        return replace(texts, queries=texts.queries.flip(0))

    monkeypatch.setattr(finished_scene, "encode_texts", exchanged)
    assert scored(word_scene())["scores"]["all"]["accuracy"] == 0.0


def test_perfect_codes_score_perfectly(usual):
    # Couch and cup, in the held-out frame and in the one that was trained on.
    asked = [(one["frame"], one["category"]) for one in usual["queries"]]
    assert asked == [(frame, name) for frame in (1, 2) for name in ("couch", "cup")]
    scores = usual["scores"]
    for name, count in (("static", 2), ("dynamic", 2), ("all", 4)):
        score = scores[name]
        assert (score["count"], score["accuracy"]) == (count, 1.0) and score["mean_iou"] > 0.8
    # Two categories leave a doubt; one alone, a couch or a cup, tells nothing of others.
    low, high = scores["all"]["accuracy_interval"]
    assert low < 0.5 and high == 1.0
    assert scores["static"]["accuracy_interval"] is None and scores["static"]["categories"] == 1
    couch, cup = usual["queries"][:2]
    assert couch["level"] == couch["mask_level"] == "whole" and couch["relevancy"] > 0.5
    assert set(couch["groups"]) == {"static", "all"} and set(cup["groups"]) == {"dynamic", "all"}
    assert couch["groups"]["all"]["instances"] == ["Couch_1"]
    # Each half of the 46 valid rows; the middle of the picture is in the right half.
    assert scores["all"]["random_pixel"] == scores["all"]["middle_pixel"] == 0.5
    assert [one["groups"]["all"]["middle_hit"] for one in (couch, cup)] == [False, True]
    assert couch["pixel"][0] < 24 <= cup["pixel"][0]
    assert couch["position"][0] < 0 < cup["position"][0]
    assert cup["position"][2] == pytest.approx(2.0, abs=0.01)


def test_the_whole_scene_is_asked_for_what_is_there_and_what_is_not(word_scene):
    found = scored(word_scene(), negatives=["couch", "basketball", "spaceship"], min_score=0.65)["presence"]
    rows = {one["phrase"]: one for one in found["queries"]}
    assert set(rows) == {"couch", "cup", "basketball", "spaceship"}
    counts = {"asked": 2, "answered": 2, "right": 2, "unverified": 0, "guessed": 0, "guessed_right": 0}
    assert found["present"] == counts
    assert found["absent"] == {"asked": 2, "answered": 0, "untaught": 1, "guessed": 0}
    assert found["separation"] == 1.0 and found["min_score"] == 0.65
    assert rows["spaceship"]["untaught"] and rows["basketball"]["right"] is None
    # A limit of one's own is no calibration; the evidence is there all the same.
    assert rows["couch"]["grade"] == "found" and rows["couch"]["probability"] is None
    assert rows["couch"]["evidence"]["lead"] > 0 > rows["basketball"]["evidence"]["lead"]


def test_a_run_tells_its_setup_and_its_log_ends_with_notice_and_alarms(word_scene, usual, monkeypatch, capfd):
    """Of four frames three have a pose, the splats tell a PSNR of 0, and four answers in two categories may be chance."""
    monkeypatch.setattr(provenance, "checkout", lambda: {"commit": "c0de", "clean": False})
    folder = word_scene(origin="real")
    found = scored(folder, told={"preset": "draft", "world_seed": 7, "camera": "real"})
    assert usual["notice"] is None and found["notice"] == notice("real", {"clip_checkpoint": "small"})
    keys = [alarm["key"] for alarm in found["alarms"]]
    assert keys == ["poses.registered", "splats.psnr", "metrics.chance"]
    assert found["alarms"][0]["figures"].items() >= {"value": 0.75, "limit": 0.9}.items()
    noted, *last = capfd.readouterr().err.splitlines()[-4:]
    assert noted == f"notice: {found['notice']}"
    assert [line.split(": ")[:2] for line in last] == [["alarm", key] for key in keys]
    recording = {"kind": "plain", "name": "a recording", "frames": 4, "seconds": 0.3, "seed": 7}
    recording |= {"camera": "real", "hash": open_artifact(folder / "frames.zarr", FRAMES).digest}
    assert found["recording"] == recording
    assert (found["preset"], found["seed"], found["clean"]) == ("draft", 3, False)
    assert found["commit"] == found["provenance"]["commit"] == "c0de"
    assert usual["recording"]["seed"] is usual["recording"]["camera"] is usual["preset"] is None


def test_renders_are_scored_where_frames_are_held_out(usual):
    held_out, trained_on, without_pose = usual["frames"]
    assert [frame["queries"] for frame in usual["frames"]] == [2, 2, 0]
    assert not trained_on["rendering"] and not without_pose["rendering"]
    assert trained_on["trained_on"] and not without_pose["registered"]
    dynamic = held_out["rendering"]["dynamic"]
    assert dynamic["psnr"] == pytest.approx(20 * math.log10(255 / 20), abs=1e-3)
    assert held_out["rendering"]["static"]["psnr"] is None  # infinite
    assert dynamic["pixels"] == 46 * 24
    assert usual["rendering"]["dynamic"] == {"frames": 1, "psnr": dynamic["psnr"], "ssim": dynamic["ssim"]}


def test_a_frame_is_asked_and_rendered_with_the_pose_as_given(word_scene_in, tmp_path, usual):
    away = np.tile(np.diag([-1.0, 1.0, -1.0, 1.0]), (4, 1, 1))
    given = {"corrections/camera_to_world": away, "held_out/render_given": np.zeros((1, 48, 48, 3), np.uint8)}
    word_scene_in(tmp_path, corrections=given)
    fitted, as_given = (scored(tmp_path, held_out=held_out) for held_out in ("corrected", "given"))
    assert fitted["scores"]["all"]["accuracy"] < 1 and fitted["rendering"] == usual["rendering"]
    assert as_given["queries"] == usual["queries"] and "rendering_without_corrections" not in usual
    assert as_given["rendering"] == fitted["rendering_without_corrections"] != fitted["rendering"]


def put_bright(folder, *spans):
    """histories.zarr with a light Gaussian in the right half at these spans of frames."""
    count, (first, last) = len(spans), np.array(spans, np.int64).reshape(-1, 2).T
    arrays = {
        "rests/thing": np.zeros(count, np.int32),
        "rests/from_frame": first,
        "rests/until_frame": last,
        "things/feature": np.zeros((int(count > 0), 128), np.float32),
        "gaussians/rest": np.arange(count, dtype=np.int32),
        "gaussians/means": np.tile(np.float32([0.5, 0, 1.5]), (count, 1)),
        "gaussians/quats": np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        "gaussians/log_scales": np.full((count, 3), np.log(0.1), np.float32),
        "gaussians/logit_opacities": np.full(count, 3, np.float32),
        "gaussians/sh": np.full((count, 1, 3), 0.2, np.float32),
    }
    put(folder, "histories", arrays, made_from=["frames", "poses", "splats"])
    return folder, (*ARTIFACTS, "histories")


@pytest.mark.parametrize("spans", [(), ((0, 0), (3, 3))])
def test_where_nothing_rests_scores_are_those_without_time(word_scene, usual, spans):
    found = scored(*put_bright(word_scene(), *spans))
    assert "rendering_without_time" not in usual
    assert found["rendering_without_time"] == found["rendering"] == usual["rendering"]
    assert found["queries"] == usual["queries"] and found["frames"] == usual["frames"]
    assert "histories.zarr" in found["artifacts"]


def test_a_frame_is_rendered_with_what_lies_there_at_its_time(word_scene_in, tmp_path, usual):
    """With the gains that were fitted to it: those of 1 change nothing."""
    found = []
    for number, gain in enumerate((None, 1.0, 0.8)):
        folder = tmp_path / str(number)
        given = {} if gain is None else {"corrections/gain": np.full((4, 3), gain)}
        word_scene_in(folder, corrections=given)
        one = scored(*put_bright(folder, (1, 1)))
        assert one["rendering_without_time"] == usual["rendering"]
        found.append(one["rendering"])
    without, same, darker = (one["dynamic"]["psnr"] for one in found)
    assert abs(without - usual["rendering"]["dynamic"]["psnr"]) > 0.1
    assert same == without and darker < without - 3.0
    assert found[0]["all"]["frames"] == 1


@pytest.mark.parametrize("frame", [1, 2])
def test_a_frame_is_asked_at_its_time(word_scene, frame):
    folder, asked = word_scene(), []
    evaluation = read_evaluation(*(open_artifact(folder / f"{one.name}.zarr", one) for one in SCORED[:4]))
    asker = SimpleNamespace(ask=lambda *given: asked.append(given[-1].second) or (), texts=None)
    list(ask_of(evaluation, asker)(frame, ["cup"]))
    assert asked == [pytest.approx(0.1 * frame)]


def test_counts_provenance_and_costs(usual):
    evaluation = {"": 3, "_annotated": 3, "_asked": 2, "_trained_on": 1, "_without_pose": 1}
    expected = {f"evaluation_frames{name}": count for name, count in evaluation.items()}
    expected |= {"frames": 4, "training_frames": 2, "annotated_instances": 2, "transient_instances": None}
    expected |= {"instances": {"part": 0, "whole": 2}}
    expected |= {"gaussians": 576, "gaussians_with_code": {"part": 0, "whole": 576}}
    assert usual["counts"].items() >= expected.items()
    assert set(usual["artifacts"]) == {f"{name}.zarr" for name in ARTIFACTS}
    assert usual["origin"] == "synthetic" and usual["scene"] == "a/scene"
    clip = usual["models"]["clip_checkpoint"]
    own, parts = usual["provenance"], usual["artifacts"].values()
    assert clip["small"] and own["models"] == {"clip_checkpoint": clip["hash"]}
    assert own["options"]["temperature"] == 10.0
    assert all(one["disk_mb"] > 0 and one["cpu_s"] >= 0 for one in parts)


def test_a_document_that_does_not_match_the_schema_is_not_written(tmp_path):
    assert finite({"a": (math.nan, 1.0), "b": [math.inf, "x"]}) == {"a": [None, 1.0], "b": [None, "x"]}
    with pytest.raises(ValidationError):
        write_document(tmp_path / "metrics.json", {"scene": "a/scene"}, "metrics")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "given, keys, frames", [({}, {"excluded": ["couch", "cup"]}, 1), ({"evaluated": ()}, {}, 0)]
)
def test_no_queries_give_no_scores(word_scene, given, keys, frames):
    folder = word_scene(inputs={"view_features.zarr": "0" * 64}, **given)
    found = scored(folder, told={"method": "LangSplat"}, **keys)
    assert found["queries"] == [] and (found["method"], found["stands_in"]) == ("LangSplat", [])
    score = {name: value for name, value in found["scores"]["all"].items() if value is not None}
    assert score == {"count": 0, "categories": 0} and found["rendering"]["all"]["frames"] == frames
    assert found["artifacts"]["view_features.zarr"] is None


def test_check_calls_metrics_of_other_artifacts_and_no_metrics_unsound(word_scene, tmp_path):
    def problem() -> str:
        return check_tree(tmp_path, print)[tmp_path / "metrics.json"]

    assert scored(word_scene()) and problem() == ""
    shutil.rmtree(tmp_path / "splats.zarr")
    shutil.copytree(tmp_path / "poses.zarr", tmp_path / "splats.zarr")
    assert "metrics.json: was made from another splats.zarr" in problem()
    (tmp_path / "metrics.json").write_bytes(b"\x89PNG\r\n\x1a\n")
    assert "cannot be read as JSON" in problem()


def test_masks_of_classes_share_the_pixels_of_a_frame(word_scene, usual):
    """Couch and cup fill one half each; what nobody labels would be wrong."""
    found = scored(word_scene(), masks="classes")
    assert "pixel_accuracy" not in usual and found["pixel_accuracy"] > 0.85
    assert found["scores"]["all"]["accuracy"] == usual["scores"]["all"]["accuracy"]
    assert all(query["mask_level"] == query["level"] for query in found["queries"])
    pixels = [query["mask_pixels"] for query in found["queries"]]
    assert max(sum(pixels[:2]), sum(pixels[2:])) <= 48 * 48
