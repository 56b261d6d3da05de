"""Each fault of a configuration is refused with the key, the line or the file that is wrong."""

import math
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

from egosplat.errors import UserError
from egosplat.pipeline import config, home
from egosplat.pipeline.scenes import find_scene, read_scenes
from egosplat.pipeline.strict_yaml import load_yaml, read_yaml
from egosplat.pipeline.variants import variant_config, with_presets
from tests.support import HEADER, PRESETS, ROOT

ROW = HEADER + "adt\ts\tadt\tr\t\n"
GIVEN = {"splats": {"source": "point_cloud.ply"}}


def read(folder: Path, edit: dict | str):
    """The scenes by the keys of a configuration, or by another table; and the variant ``mine`` of keys of variants."""
    keys, table = ({}, edit) if isinstance(edit, str) else (edit, ROW)
    (folder / "scenes.tsv").write_text(table)
    found = config.resolve({"scenes": str(folder / "scenes.tsv")} | keys, PRESETS)
    if "variants" in keys:
        variant_config(found, "mine", "adt/scene1")
    return read_scenes(found)


def published(key: str, value: str) -> dict:
    return {"models": {"set": "published", key: value}}


FAULTS = [
    ({"frames": {"resolutoin": 3}}, "unknown key 'frames.resolutoin'; did you mean 'resolution'?"),
    ({"xyz": {}}, "unknown key 'xyz'; known keys: preset, scenes"),
    ({"max_points": 2}, "did you mean .*splats.max_points"),
    ({"frames.stride": 2}, "'frames.stride'; write frames: {stride: ...}"),
    ({"frames": {"resolution": 3}}, "frames.resolution = 3 .* 32"),
    ({"frames": {"resolution": 512.0}}, "frames.resolution = 512.0 .* whole number"),
    ({"transient": {"lr": math.nan}}, "transient.lr = nan .* a number"),
    *(
        ({"splats": {"iterations": text}}, r"splats\.iterations = .*whole number")
        for text in ("five", "3.0", "1e400", "[5]", "", "2020-01-01")
    ),
    *(
        ({"splats": {"max_points": value}}, r"splats\.max_points = .*whole number")
        for value in (True, 3.0, math.nan, math.inf, 2**31, -1)
    ),
    ({"models": {"cache": True}}, "models.cache = True .* a text"),
    ({"splats": 5}, "splats = 5 .* splats: {masking: auto}"),
    ({"splats": {"iterations:5": ""}}, "iterations: 5"),
    ({"features": {"dims": "most"}}, "features.dims = 'most' .* a whole number or auto"),
    ({"transient": {"input_size": 100}}, "transient.input_size = 100 .* a multiple of 32"),
    ({"tradeoff": {"variants": ["a", "a"]}}, "tradeoff.variants = .* no repeated items"),
    ({"poses": {"matching": "exhausting"}}, "poses.matching .* auto, exhaustive, sequential .* 'exhaustive'"),
    ({"query": {"canonical": [3]}}, "query.canonical.0 = 3 .* string"),
    ({"preset": "drafty"}, "preset = 'drafty' .* accurate, balanced, draft, paper, quick .*'draft'"),
    ({"data_root": {"adt": ""}}, "data_root.adt = '' .* at least 1"),
    ({"data_root": {False: "/x"}}, "data_root.* is not allowed"),
    ({"data_root": {"adtt": "/data"}}, "data_root.adtt"),
    (published("sam2_config", "sam2_hiera_l"), "sam2_checkpoint = published: .*_hiera_l'.*sam2.1_hiera_l"),
    (published("clip_model", "ViT-H-14"), "clip_checkpoint = published: .*'ViT-H-14'.*ViT-L-14"),
    # Gaussians that another program trained.
    (GIVEN | {"camera": {"refine_poses": "on"}}, "splats.source: .*camera.refine_poses = off, not on"),
    (GIVEN | {"camera": {"compensate_exposure": "on"}}, "splats.source: .*compensate_exposure = off"),
    ({"splats": GIVEN["splats"] | {"language": "joint"}}, "splats.source: .*language = after, not joint"),
    # Keys of a format.
    ({"formats": {"hoi5d": {}}}, "formats.hoi5d = .* 'adt', 'hoi4d', 'plain'"),
    ({"formats": {"hoi4d": {"preset": "draft"}}}, "formats.hoi4d = .* preset .* hold for all scenes"),
    ({"formats": {"hoi4d": {"masks": {"treshold": 1}}}}, "formats.hoi4d: unknown key 'masks.treshold'; did"),
    ({"formats": {"plain": {"masks": {"threshold": 7}}}}, "formats.plain: masks.threshold = 7 .* 1"),
    # Variants.
    ({"variants": {"a/b": {}}}, "variants.a/b .* only letters, digits, _ and -"),
    ({"variants": {}}, "no variant 'mine'.*take one of: baseline"),
    ({"variants": {f"v{number}": {} for number in range(20)}}, r"no variant 'mine'.*, \d+ more$"),
    ({"variants": {"mine": {"splats": {"masking": "all"}}}}, r"variant mine: splats\.masking = 'all'"),
    ({"variants": {"mine": {"synthetic": {"seed": 9}}}}, "leave out the section synthetic"),
    ({"variants": {"mine": {"preset": "draft"}}}, "a variant cannot change preset"),
    (
        {"variants": {"mine": {"extends": ["c", "b"]}, "b": {"extends": "mine"}, "c": {}}},
        "variant mine: circular .* mine -> b -> mine",
    ),
    # Tables of scenes.
    ("dataset scene\n", "needs dataset, scene, format, recording, options, tab-separated"),
    (ROW + ROW.removeprefix(HEADER), "line 3: scene adt/s is in the table twice"),
    (HEADER + "ADT!\ts\tadt\tr\t\n", "line 2: dataset = 'ADT!' is not allowed"),
    (HEADER + "adt\ta.b\tadt\tr\t\n", "line 2: scene = 'a.b' .* only letters, digits, _ and -"),
    (
        HEADER + "adt\ts\tavi\tr\t\n",
        "line 2: format = 'avi' is not allowed: must be one of adt, hoi4d, plain",
    ),
    (HEADER + "adt\ts\tadt\t-\t\n", "line 2: recording - .* synthetic.seed"),
    (HEADER + "adt\ts\tadt\tr\tstride=3\n", "option 'stride=3' is not of the form section.key=value"),
    (HEADER + "adt\ts\tadt\tr\tframes.strid=3\n", "line 2: .*'frames.strid'.* 'stride'"),
    (HEADER + "adt\ts\tadt\tr\tframes.stride=2 frames.stride=3\n", "line 2: .*'frames.stride' .* twice"),
]


@pytest.mark.parametrize("edit, message", FAULTS)
def test_a_fault_is_named_in_a_line_or_two(tmp_path, edit, message):
    with pytest.raises(UserError, match=message) as caught:
        read(tmp_path, edit)
    assert str(caught.value).count("\n") <= 1


def test_an_error_names_the_last_layer_that_sets_the_key():
    layers = [config.Layer(where, {"frames": {"stride": 0}}) for where in ("first", "second")]
    with pytest.raises(UserError, match="^second: frames.stride"):
        config.configure([*layers, config.Layer("third", {"frames": {"resolution": 64}})])


def test_absent_and_faulty_files_and_unknown_scenes_are_named(tmp_path, monkeypatch):
    with pytest.raises(UserError, match="none.tsv"):
        read_scenes(config.resolve({"scenes": str(tmp_path / "none.tsv")}, PRESETS))
    with pytest.raises(UserError, match="adt/t .*adt/s"):
        find_scene(read(tmp_path, ROW), "adt", "t")
    (tmp_path / "draft.yaml").write_text("frames: {strid: 3}")
    with pytest.raises(UserError, match="draft.yaml: .*'frames.strid'.* 'stride'"):
        config.resolve({"preset": "draft"}, tmp_path)
    with pytest.raises(UserError, match="preset draft.yaml: .*'frames.strid'"):
        with_presets(config.resolve({}, tmp_path), tmp_path, "adt")
    (tmp_path / "config/presets").mkdir(parents=True)
    (tmp_path / "config/presets/.#draft.yaml").symlink_to("me@here")  # of an editor
    monkeypatch.chdir(tmp_path)
    assert ".#draft" not in runpy.run_path(home.__file__)["PRESET_NAMES"]


@pytest.mark.parametrize(
    "text, where",
    [
        ("preset: draft\nframes: {}\npreset: paper\n", "line 3, column 1: .*'preset'"),
        ("splats:\n  iterations: 5\n  seed: 1\n  iterations: 6\n", "line 4, column 3: .*'iterations'"),
        ("frames: {stride: 1, stride: 2}\n", "line 1, column 21: .*'stride'"),
        ('{"frames": {"stride": 2, "stride": 3}}', "line 1, column 26: .*'stride'"),
        ("frames: [", "line 1, column 10"),
        ("frames:\n  stride: 2\n\tfocal: 3\n", r"line 3, column 1: found character '\\t'"),
        ("a: 1\nb: *nothing\n", "line 2, column 4: found undefined alias"),
        ("a: 1\n---\nb: 2\n", "line 2, column 1"),
        ("a: 1\nb: 'x\n", "line 3, column 1"),
        ("[" * 5000, "recursion"),
        ("- 1", "list"),
    ],
)
def test_a_faulty_yaml_file_is_named_with_line_and_column(tmp_path, text, where):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UserError, match=f"mine.yaml: .*{where}"):
        read_yaml(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    "text, value",
    [
        ("a: {x: 1}\nb: {x: 2}\n", {"a": {"x": 1}, "b": {"x": 2}}),
        ("a: &a {x: 1}\nb: {<<: *a, x: 2}\n", {"a": {"x": 1}, "b": {"x": 2}}),
        *(("1e-4", 1e-4), ("5E3", 5000.0), ("-2.e2", -200.0), (".5e1", 5.0), ("1e", "1e"), ("12", 12)),
    ],
)
def test_keys_of_several_mappings_may_be_alike_and_numbers_may_have_an_exponent(text, value):
    found = load_yaml(text)
    assert found == value and type(found) is type(value)


def test_a_plan_ends_with_a_line_where_a_key_is_set_twice_or_a_file_cannot_be_read(tmp_path):
    """Snakemake takes the last value of a key without a word, and a file's error for one of the program."""
    code, more = str(ROOT / "workflow/common/start.smk"), tmp_path / "more.yaml"
    given = {"workflow": SimpleNamespace(overwrite_configfiles=[more])}
    more.write_text("frames: {stride: 1}")
    with pytest.raises(SystemExit, match=f"egosplat: {tmp_path}: Is a directory"):
        runpy.run_path(code, given)["or_exit"](tmp_path.read_bytes)
    more.write_text("frames: {stride: 1, stride: 2}")
    with pytest.raises(SystemExit, match="egosplat: .*/more.yaml: .*'stride' is set twice"):
        runpy.run_path(code, given)
