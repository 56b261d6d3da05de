"""Another method's relevancy maps, laid out by anyone, are scored."""

import json
import re
import runpy
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import zarr

from egosplat.artifacts.relevancy import open_relevancy
from egosplat.baselines import external_maps as external
from egosplat.errors import UserError
from egosplat.evaluation.scored_scenes import PROTOCOL
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.validation import Draft202012Validator, schema
from tests.support.scenes import put

HEIGHT, WIDTH, FRAMES_TOTAL = 30, 40, 4
DOC = Path(__file__).parents[3] / "docs" / "methods.md"
OF_EGOSPLAT = {
    "training_frames",
    "instances",
    "transient_instances",
    "views",
    "gaussians",
    "gaussians_with_code",
    "code_channels",
}


@pytest.fixture
def scene(tmp_path, instance_map, instances) -> Path:
    """Frames 1 and 3 are annotated; frame 3 has no pose."""
    folder = tmp_path / "scene"
    frames = {
        "rgb": np.zeros((FRAMES_TOTAL, HEIGHT, WIDTH, 3), np.uint8),
        "train": np.array([True, False, True, False]),
    }
    put(folder, "frames", frames, {"recording": "recording", "format": "adt"})
    put(folder, "poses", {"registered": np.array([True, True, True, False])})
    annotations = {"frame": np.array([1, 3]), "instance_map": np.stack([instance_map] * 2)}
    put(folder, "annotations", annotations, {"instances": [asdict(one) for one in instances]})
    return folder


def write(path: Path, maps: np.ndarray, queries: list[tuple[int, str]], **attributes) -> Path:
    """Maps as anyone would write them, (query, level, height, width)."""
    group = zarr.open_group(path, mode="w")
    group.create_array("relevancy", shape=maps.shape, chunks=(1, *maps.shape[1:]), dtype=maps.dtype)[...] = (
        maps
    )
    frames = np.array([frame for frame, _ in queries], np.int32)
    group.create_array("frame", shape=frames.shape, dtype=frames.dtype)[...] = frames
    told = {
        "schema": "relevancy",
        "format_version": 1,
        "method": "Mine",
        "levels": [f"level {number}" for number in range(maps.shape[1])],
        "category": [category for _, category in queries],
    }
    group.attrs.update(told | attributes)
    return path


QUERIES = [(1, "dining chair"), (1, "book")]


@pytest.fixture
def perfect(instance_map) -> np.ndarray:
    """(2, 1, 30, 40) float16: 1 on the chair, then on both books, else 0.2."""
    truth = np.stack([instance_map == 0, np.isin(instance_map, (1, 2))])
    return np.where(truth, 1.0, 0.2).astype(np.float16)[:, None]


@pytest.fixture
def scored(tmp_path, scene):
    """``scored(relevancy, **keys)``: what the stage writes, without smoothing."""

    def run(relevancy: Path, **keys) -> dict:
        paths = {f"{name}_path": scene / f"{name}.zarr" for name in ("frames", "poses", "annotations")}
        output = tmp_path / "metrics.json"
        keys = {"box_filter": 0.0, "majority_filter": 0.0} | keys
        options = external.MethodMetricsOptions(**keys)
        external.run(**paths, relevancy_path=relevancy, output=output, options=options, title="adt/scene1")
        return json.loads(output.read_text())

    return run


def test_perfect_maps_have_perfect_scores(tmp_path, scored, perfect):
    found = scored(write(tmp_path / "mine.zarr", perfect, QUERIES))
    Draft202012Validator(schema("metrics")).validate(found)
    assert (found["method"], found["scene"], found["origin"]) == ("Mine", "adt/scene1", "synthetic")
    assert found["recording"]["kind"] == "adt" and found["recording"]["frames"] == FRAMES_TOTAL
    assert found["scores"]["all"]["count"] == 2
    assert (found["scores"]["all"]["accuracy"], found["scores"]["all"]["mean_iou"]) == (1.0, 1.0)
    # One of the two books is moving, and one location cannot hit both.
    assert found["scores"]["static"]["accuracy"] + found["scores"]["dynamic"]["accuracy"] in (1.0, 1.5)
    book, chair = found["queries"]
    # Of both books one is static: of the groups' truth, the mask covers more.
    assert book["groups"]["static"]["iou"] == pytest.approx(24 / 84)
    assert chair["level"] == chair["mask_level"] == "level 0" and chair["position"] is None
    assert chair["mask_pixels"] == 80 and set(chair["groups"]) == {"static", "all"}


def test_frames_without_a_pose_are_not_asked(tmp_path, scored, perfect):
    found = scored(write(tmp_path / "mine.zarr", perfect, QUERIES))
    assert [(one["frame"], one["queries"], one["registered"]) for one in found["frames"]] == [
        (1, 2, True),
        (3, 0, False),
    ]
    assert found["counts"]["evaluation_frames_asked"] == 1
    assert not OF_EGOSPLAT & set(found["counts"])


def test_provenance_names_inputs_options_and_versions(tmp_path, scored, perfect):
    path = write(tmp_path / "mine.zarr", perfect, QUERIES)
    first = scored(path)["provenance"]
    assert set(first["inputs"]) == {"frames.zarr", "poses.zarr", "annotations.zarr", "mine.zarr"}
    assert set(PROTOCOL) <= set(first["options"])
    assert first["stage"] == "method_metrics"
    # The table of stages is egosplat's own: what renders nothing needs no model, but what scores it counts.
    assert {*STAGES["method_metrics"].libraries, "egosplat", "python"} == set(first["versions"])
    assert {"numpy", "scipy", "zarr"} <= set(first["versions"])
    renamed = scored(write(path, perfect, QUERIES, method="Yours"))["provenance"]
    changed = scored(write(path, 0.5 * perfect, QUERIES))["provenance"]
    assert len({one["inputs"]["mine.zarr"] for one in (first, renamed, changed)}) == 3


def test_the_best_level_answers(tmp_path, scored, perfect):
    flat = np.full_like(perfect, 0.3)
    found = scored(write(tmp_path / "mine.zarr", np.concatenate([flat, perfect], axis=1), QUERIES))
    assert {one["level"] for one in found["queries"]} == {"level 1"}
    assert found["scores"]["all"]["accuracy"] == 1.0


def test_nothing_is_found_where_every_value_is_nan(tmp_path, scored, perfect):
    found = scored(write(tmp_path / "mine.zarr", np.full_like(perfect, np.nan), QUERIES))
    for one in found["queries"]:
        assert (one["relevancy"], one["level"], one["pixel"], one["mask_pixels"]) == (0.0, None, None, 0)
        assert not any(truth["hit"] or truth["iou"] for truth in one["groups"].values())


def test_of_many_maxima_the_innermost_is_scored(tmp_path, scored):
    found = scored(write(tmp_path / "mine.zarr", np.full((2, 1, HEIGHT, WIDTH), 0.5, np.float32), QUERIES))
    for one in found["queries"]:
        assert abs(one["pixel"][0] - WIDTH / 2) < 5 and abs(one["pixel"][1] - HEIGHT / 2) <= 1


def test_dtype_size_and_order_of_maps_do_not_change_scores(tmp_path, scored, perfect):
    first = scored(write(tmp_path / "a.zarr", perfect, QUERIES))["queries"]
    swapped = perfect[::-1].astype(np.float32)
    again = scored(write(tmp_path / "b.zarr", swapped, QUERIES[::-1] + []))["queries"]
    assert [one["groups"] for one in again] == [one["groups"] for one in first]
    small = scored(write(tmp_path / "c.zarr", perfect[..., ::2, ::2].copy(), QUERIES))
    assert small["scores"]["all"]["accuracy"] == 1.0 and small["scores"]["all"]["mean_iou"] > 0.6


def test_maps_of_no_query_are_not_read(tmp_path, scored, perfect):
    queries = [*QUERIES, (1, "sofa"), (3, "book")]
    maps = np.concatenate([perfect, np.full_like(perfect, 7.0)])
    assert scored(write(tmp_path / "mine.zarr", maps, queries))["scores"]["all"]["accuracy"] == 1.0


@pytest.mark.parametrize("kept", [0, 1])
def test_a_query_that_is_left_out_is_an_error(tmp_path, scored, perfect, kept):
    path = write(tmp_path / "mine.zarr", perfect[kept : kept + 1], QUERIES[kept : kept + 1])
    with pytest.raises(UserError, match=f"1 of 2 .*'{QUERIES[1 - kept][1]}' in frame 1"):
        scored(path)


@pytest.mark.parametrize("value", [-0.1, 1.5, np.inf])
def test_numbers_outside_their_range_are_an_error(tmp_path, scored, perfect, value):
    perfect[1, 0, 3, 4] = value
    with pytest.raises(UserError, match=r"'relevancy', chunk 1 .* 0\.\.1, or NaN, and 1 of"):
        scored(write(tmp_path / "mine.zarr", perfect, QUERIES))


@pytest.mark.parametrize(
    "attributes, message",
    [
        ({"schema": "other"}, "attribute schema = 'other'"),
        ({"format_version": 2}, "attribute format_version = 2"),
        ({"method": ""}, "attribute method"),
        ({"method": "a\nb"}, "attribute method"),
        ({"method": 61 * "a"}, "attribute method"),
        ({"method": None}, "attribute method"),
        ({"levels": ["a", "b"]}, "attribute levels has 2 texts, the arrays have 1"),
        ({"levels": "a"}, "attribute levels = 'a'"),
        ({"category": ["book", 1]}, "attribute category.1 = 1"),
        ({"category": ["book", "book"]}, "holds a category twice in one frame"),
    ],
)
def test_attributes_that_are_wrong_are_named(tmp_path, perfect, attributes, message):
    path = write(tmp_path / "mine.zarr", perfect, QUERIES, **attributes)
    with pytest.raises(UserError, match=f"mine.zarr: .*{message}"):
        open_relevancy(path)


def test_arrays_that_are_wrong_are_named(tmp_path, perfect, scored):
    path = tmp_path / "mine.zarr"
    for maps, message in (
        (perfect.astype(np.float64), "'relevancy' is float64, not float32"),
        (perfect[:, 0], "has 3 axes, not 4"),
        (perfect[:1], "'frame' has size 2 along axis 'query', not 1"),
    ):
        with pytest.raises(UserError, match=message):
            open_relevancy(write(path, maps, QUERIES))
    with pytest.raises(UserError, match="20x30 .*40x30"):
        scored(write(path, perfect[..., :20].copy(), QUERIES))


def test_missing_arrays_and_chunks_are_named(tmp_path, perfect):
    path = tmp_path / "mine.zarr"
    with pytest.raises(UserError, match="does not exist"):
        open_relevancy(path)
    write(path, perfect, QUERIES)
    (path / "relevancy" / "c" / "1" / "0" / "0" / "0").unlink()
    with pytest.raises(UserError, match="'relevancy' .*1 of 2 chunks"):
        open_relevancy(path)
    shutil.rmtree(path / "relevancy")
    with pytest.raises(UserError, match="'relevancy'"):
        open_relevancy(path)
    (path / "zarr.json").write_text("{")
    with pytest.raises(UserError, match="mine.zarr.*Zarr"):
        open_relevancy(path)


def test_damage_is_named_when_it_is_read(tmp_path, perfect):
    path = write(tmp_path / "mine.zarr", perfect, QUERIES)
    chunk = path / "relevancy" / "c" / "1" / "0" / "0" / "0"
    chunk.write_bytes(b"nonsense")
    maps = open_relevancy(path)
    assert maps.maps(1, "dining chair").shape == (1, HEIGHT, WIDTH)
    with pytest.raises(UserError, match="'relevancy', chunk 1 "):
        maps.maps(1, "book")
    frames = path / "frame" / "c" / "0"
    frames.write_bytes(frames.read_bytes()[:5])
    with pytest.raises(UserError, match="'frame'"):
        open_relevancy(path)
    (path / "frame" / "zarr.json").write_text("")
    with pytest.raises(UserError, match="'frame'"):
        open_relevancy(path)


@pytest.fixture
def documented(tmp_path, monkeypatch):
    """``documented(index)``: the names that an example of the documentation leaves, run in an empty folder."""

    def run(index: int) -> dict:
        script = tmp_path / "example.py"
        script.write_text(re.findall(r"```python\n(.*?)```", DOC.read_text(), re.DOTALL)[index])
        monkeypatch.chdir(tmp_path)
        return runpy.run_path(str(script))

    return run


def test_the_documented_example_writes_what_is_read(tmp_path, documented):
    documented(1)
    found = open_relevancy(tmp_path / "my_method.zarr")
    assert (found.method, found.levels, found.size) == ("My method", ("all",), (30, 40))
    assert found.maps(12, "book").dtype == np.float32
    assert set(found.rows) == {(12, "book"), (12, "dining chair")}


def test_the_documented_listing_lists_the_queries(scene, documented, tmp_path):
    shutil.copytree(scene, tmp_path / "results" / "adt" / "scene1")
    expected = [(1, "book"), (1, "dining chair"), (3, "book"), (3, "dining chair")]
    assert documented(0)["queries"] == expected


def test_masks_of_classes_are_those_of_the_most_relevant_maps(tmp_path, scored, perfect):
    """Every category of the recording competes, so each needs a map."""
    with pytest.raises(UserError, match="no map for 1 of 3 queries, the first 'person' in frame 1"):
        scored(
            write(tmp_path / "mine.zarr", perfect, QUERIES),
            masks="classes",
            people=True,
            excluded=("shelter",),
        )
    # Most relevant at the chair's upper half, and a little everywhere.
    bold = np.full_like(perfect[:1], 0.3)
    bold[..., :6, :] = 1.5
    queries = [*QUERIES, (1, "person")]
    maps = np.concatenate([perfect, np.minimum(bold, 1.0)])
    maps[0, 0, :6] *= 0.5
    keys = {"masks": "classes", "people": True, "excluded": ("shelter",)}
    found = scored(write(tmp_path / "all.zarr", maps, queries), **keys)
    chair = next(one for one in found["queries"] if one["category"] == "dining chair")
    assert chair["mask_pixels"] == 40 and chair["groups"]["all"]["iou"] == 0.5
    assert 0 < found["pixel_accuracy"] < 1
