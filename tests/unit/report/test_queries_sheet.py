"""The page of a scene's queries shows what was scored, the best and the worst of it."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.evaluation.options import MetricsOptions, recorded_options
from egosplat.evaluation.scores import iou
from egosplat.pipeline.validation import read_document
from egosplat.query import finished_scene
from egosplat.report.sheets.queries_sheet import (
    ScoredQuery,
    ask_again,
    best_and_worst,
    run,
    scored_queries,
    summary,
)
from egosplat_rivals.methods_sheet import open_scored
from tests.support.scenes import put
from tests.unit.evaluation.conftest import ARTIFACTS, score

GREEN, RED = (34, 139, 34), (255, 0, 0)


def draw(folder: Path) -> np.ndarray:
    """(H, W, 3) the page of a scored folder."""
    output = folder / "queries.png"
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in ARTIFACTS}
    run(**paths, metrics_path=folder / "metrics.json", output=output, title="a/scene")
    assert [path.name for path in folder.iterdir() if path.suffix == ".png"] == [output.name]
    return np.asarray(Image.open(output).convert("RGB"))


def change(metrics: Path, **values) -> None:
    metrics.write_text(json.dumps(json.loads(metrics.read_text()) | values))


def miss(metrics: Path, category: str) -> None:
    """Tell that a category was missed."""
    queries = json.loads(metrics.read_text())["queries"]
    for one in queries:
        one["groups"]["all"] |= {"hit": False, "iou": 0.0} if one["category"] == category else {}
    change(metrics, queries=queries)


def marks(page: np.ndarray) -> list[tuple[bool, bool]]:
    """Of each of the two blocks, whether something of it is marked as found, and as missed."""
    middle = page.shape[1] // 2
    blocks = page[:, :middle], page[:, middle:]
    return [tuple(int((one == color).all(axis=-1).sum()) > 20 for color in (GREEN, RED)) for one in blocks]


def test_what_was_found_is_on_the_left_and_what_was_missed_on_the_right_below_the_alarms(word_scene):
    folder = word_scene()
    metrics = score(folder)
    change(metrics, alarms=[])
    found = draw(folder)
    height, width, _ = found.shape
    assert width > 1500 and height > 500  # couch and cup, one below the other
    assert marks(found) == [(True, False), (False, False)]
    miss(metrics, "cup")
    both = draw(folder)
    assert both.shape[0] < height  # a row each, beside each other
    assert marks(both) == [(True, False), (False, True)]
    miss(metrics, "couch")
    alarm = {"key": "masks.pixels", "figures": {"value": 0.5, "limit": 0.25}}
    change(metrics, notice="small", alarms=[alarm, alarm])
    none = draw(folder)
    assert marks(none) == [(False, False), (False, True)] and none.shape[0] > height


def test_the_maps_are_those_that_were_scored(word_scene):
    folder = word_scene()
    scored = read_document(score(folder, resolution=40, canonical=["thing"], box_filter=0.1), "metrics")
    scene = open_scored(folder, recorded_options(scored["provenance"]["options"]))
    queries = scored_queries(scored)
    shown = {one.scored: one for one in ask_again(queries, scene, scored, folder / "metrics.json")}
    assert len(shown) == len(queries) == 4
    valid = scene.valid
    for query, told in zip(queries, scored["queries"], strict=True):
        one = shown[query]
        assert list(one.answer.pixel) == told["pixel"] and one.answer.score == told["relevancy"]
        assert iou(one.answer.mask, one.target, valid) == query.iou == told["groups"]["all"]["iou"]
        # The annotated left half is the couch, the right one the cup, and the two uppermost rows are not valid.
        left = [0, 2, 23, 47]
        assert one.boxes.tolist() == [left if query.category == "couch" else [24, 2, 47, 47]]
        assert one.target.sum() == 46 * 24


def test_a_frame_that_was_asked_at_its_given_pose_is_drawn_there(word_scene):
    away = {"corrections/camera_to_world": np.tile(np.diag([-1.0, 1.0, -1.0, 1.0]), (4, 1, 1))}
    folder = word_scene(corrections=away | {"held_out/render_given": np.zeros((1, 48, 48, 3), np.uint8)})
    scored = read_document(score(folder, held_out="given"), "metrics")
    scene = open_scored(folder, recorded_options(scored["provenance"]["options"]))
    [shown] = ask_again(scored_queries(scored)[:1], scene, scored, folder / "metrics.json")
    np.testing.assert_array_equal(shown.view, scene.render(pose=np.eye(4)))


def test_frames_that_were_asked_at_their_time_are_so_again(word_scene):
    folder = word_scene()
    for in_time in (False, True):
        assert open_scored(folder, MetricsOptions(), in_time=in_time).rests is None
    shapes = {"gaussians/sh": (0, 1, 3), "things/feature": (0, 128)}
    nothing = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    put(folder, "histories", nothing, made_from=["frames", "poses", "splats"])
    scored = read_document(score(folder, (*ARTIFACTS, "histories")), "metrics")
    options = recorded_options(scored["provenance"]["options"])
    scene = open_scored(folder, options, in_time=True)
    assert len(list(ask_again(scored_queries(scored)[:1], scene, scored, folder / "metrics.json"))) == 1
    assert scene.rests is not None and open_scored(folder, options).rests is None


def test_without_a_query_the_page_says_so(word_scene, monkeypatch):
    metrics = score(word_scene(), excluded=["couch", "cup"])
    monkeypatch.setattr(finished_scene, "load_clip_of", None)  # nothing is asked
    picture = draw(metrics.parent)
    assert picture.shape[0] < 400 and picture.min() < 50
    told = summary(read_document(metrics, "metrics"))
    assert told == "no queries; origin synthetic, small checkpoints"


def test_the_heading_tells_the_scores_and_where_they_come_from(word_scene):
    metrics = score(word_scene())
    told, how_to_read = summary(read_document(metrics, "metrics")).split("\n")
    assert "their boxes dashed" in how_to_read
    # Of two categories; those of four independent queries would begin at 51.
    assert told.startswith("4 queries; accuracy 100.0 % (34.2 to 100.0), mIoU ")
    assert "chance: a random pixel 50.0 %, the middle of the picture 50.0 %" in told
    assert told.endswith("origin synthetic, small checkpoints")
    scores = json.loads(metrics.read_text())["scores"]
    scores["all"] |= {"count": 1, "mean_iou": 0.5, "mean_iou_interval": None}
    change(metrics, scores=scores)
    assert ", mIoU 50.0 %; chance" in summary(read_document(metrics, "metrics"))


def test_scores_of_other_artifacts_are_rejected(word_scene):
    folder = word_scene()
    kept = score(folder).read_bytes()
    word_scene(nudge=0.001)
    (folder / "metrics.json").write_bytes(kept)
    with pytest.raises(UserError, match=r"metrics.json: was made from another splats.zarr .*Rebuild it: "):
        draw(folder)
    assert not (folder / "queries.png").exists()


def test_the_best_were_found_and_the_worst_missed_and_a_category_is_shown_once():
    rows = [("sofa", True, 0.5), ("sofa", True, 0.7), ("sofa", False, 0.0), ("cup", False, 0.1)]
    rows += [("cup", False, 0.2), ("lamp", True, 0.8), ("rug", False, 0.9)]
    queries = [ScoredQuery(frame, name, 0.5, *rest) for frame, (name, *rest) in enumerate(rows, 1)]
    # The second best category has no room among one best: what was missed of it may be among the worst.
    for count, frames in ((3, ([6, 2], [4, 7])), (1, ([6], [3]))):
        assert tuple([one.frame for one in block] for block in best_and_worst(queries, count)) == frames
    assert best_and_worst([], 3) == ([], [])


def test_ties_do_not_depend_on_the_order_of_the_file():
    found = [ScoredQuery(frame, name, 0.5, True, 0.5) for frame, name in ((1, "b"), (1, "c"), (2, "a"))]
    rows = (("e", 1, 0.9), ("f", 1, 0.8), ("g", 1, 0.8), ("d", 2, 0.8))
    missed = [ScoredQuery(frame, name, relevancy, False, 0.0) for name, frame, relevancy in rows]
    for order in (1, -1):
        assert best_and_worst([*found, *missed][::order], 4) == (found, missed)
