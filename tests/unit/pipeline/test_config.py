"""The configuration has one schema, code and documentation follow it, and errors say what to do."""

import ast
import inspect
import re
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
import yaml

from egosplat.artifacts.schemas import SCHEMAS
from egosplat.evaluation.options import recorded_options
from egosplat.pipeline import config
from egosplat.pipeline.config_table import FIRST_KEYS, keys_page
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.options import Options, keys_of
from egosplat.pipeline.scenes import SHIPPED_DATASETS, is_own, read_scenes
from egosplat.pipeline.stages import STAGES, path_help
from egosplat.pipeline.variants import variant_config
from tests.support import HEADER, PRESETS, ROOT
from tests.support.tables import scenes_of

LADDER = keys_of(GeneralOptions)["preset"]["enum"]
SECTIONS = config.section_options()


def test_every_key_has_a_description_and_a_default():
    for keys in (keys_of(GeneralOptions), *map(config.section_keys, SECTIONS)):
        for name, key in keys.items():
            assert len(key["description"]) > 8 and "default" in key, name


@pytest.mark.parametrize("stage", STAGES)
def test_the_record_and_the_function_of_a_stage_name_the_same_paths_and_options(stage):
    about, named = STAGES[stage], inspect.signature(import_module(STAGES[stage].module).run).parameters
    chunks = {"chunk": None, "gather": ()} if about.by_chunks else {}
    assert chunks == {name: named[name].default for name in ("chunk", "gather") if name in named}
    opened_by_name = inspect.Parameter.VAR_KEYWORD
    others = {name for name, one in named.items() if one.kind == opened_by_name}
    arguments = {name: one for name, one in named.items() if name not in {*chunks, *others}}
    options = config.stage_options(stage)
    if stage.endswith("_sheet") and "title" not in named:  # the decorator ``sheet`` opens the artifacts
        assert [*named] == [*about.inputs] and about.scene == ("title",) and options is None
        return
    paths = {name if name == "output" else f"{name}_path" for name in path_help(about)}
    told = {*paths, *about.scene, *(("options",) if options else ())}
    assert set(arguments) <= told and (others or set(arguments) == told)
    assert options is None or arguments["options"].annotation is options
    for name, argument in arguments.items():
        # A real recording has no seed, for example.
        unknown = name in about.scene and type(None) in get_args(argument.annotation)
        optional = name.removesuffix("_path") in about.optional or unknown
        assert argument.default is (None if optional else inspect.Parameter.empty), name


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_gets_each_value_of_its_options(stage):
    options, values = config.stage_options(stage), config.stage_values(stage, config.defaults())
    assert values == (options().as_dict() if options else {})
    assert set(config.stage_sections(stage)) <= set(SECTIONS)


def test_only_options_have_a_base_whose_name_ends_with_options():
    named = [
        (path, node)
        for path in (ROOT / "src").glob("egosplat*/**/*.py")
        for node in ast.walk(ast.parse(path.read_bytes()))
        if isinstance(node, ast.ClassDef)
        and any(isinstance(base, ast.Name) and base.id.endswith("Options") for base in node.bases)
    ]
    assert len(named) > 30
    for path, node in named:
        name = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts)
        assert issubclass(getattr(import_module(name), node.name), Options), (name, node.name)


def test_the_presets_are_allowed_and_all_but_the_paper_film_the_same_apartment(tmp_path):
    assert sorted(LADDER) == sorted(path.stem for path in PRESETS.glob("*.yaml"))
    for preset in LADDER:
        resolved = config.resolve({"preset": preset}, PRESETS)
        for section, keys in yaml.safe_load((PRESETS / f"{preset}.yaml").read_text()).items():
            assert resolved[section].items() >= keys.items()
        film = config.defaults()["synthetic"]
        assert resolved["synthetic"] == film if preset != "paper" else resolved["synthetic"]["size"] == 1408
    (tmp_path / "draft.yaml").write_text("frames: {stride: 7}")  # beside those that come with egosplat
    found = {name: config.resolve({"preset": name}, tmp_path)["frames"] for name in ("draft", "quick")}
    assert found["draft"]["stride"] == 7 and found["quick"]["resolution"] != found["draft"]["resolution"]


def test_the_shipped_configuration_sets_no_stage_key():
    shipped = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    roots = dict.fromkeys(SHIPPED_DATASETS)
    assert config.resolve(shipped, PRESETS) == config.defaults() | {"data_root": roots}
    assert config.resolve({}, PRESETS) == config.defaults()  # that of the preset balanced


def test_a_benchmark_has_its_protocol_and_the_user_s_key_wins():
    chosen = {"preset": "draft", "models": {"set": "published"}}
    found = config.of_format(config.resolve(chosen, PRESETS), "lerf")
    assert (found["frames"]["resolution"], found["frames"]["holdout"]) == (986, False)
    query = recorded_options(config.stage_values("metrics", found))
    assert (query.box_filter_px(986), query.majority_px(986), query.masks) == (30, 7, "threshold")
    assert query.temperature == 10.0
    mine = {"frames": {"resolution": 512}, "formats": {"lerf": {"metrics": {"min_area": 0.01}}}}
    found = config.of_format(config.resolve(mine, PRESETS), "lerf")
    assert (found["frames"]["resolution"], found["frames"]["holdout"]) == (512, False)
    assert (found["metrics"]["min_area"], found["metrics"]["excluded"]) == (0.01, [])
    assert config.of_format(config.resolve({}, PRESETS), "3d_ovs")["metrics"]["masks"] == "classes"
    assert config.of_format(config.resolve({}, PRESETS), "plain")["metrics"]["masks"] == "threshold"


def test_variants_of_the_user_stand_beside_the_default_ones():
    mine = {"features": {"dims": 3}}
    found = config.resolve({"variants": {"mine": mine, "baseline": mine}}, PRESETS)["variants"]
    assert found == config.defaults()["variants"] | {"mine": mine, "baseline": mine}


@pytest.mark.parametrize(
    "section, key, text, value",
    [
        ("splats", "iterations", "5", 5),
        ("language", "lr", "1e-4", 1e-4),
        ("frames", "holdout", "false", False),
        ("features", "dims", "7", 7),
        ("frames", "end_s", "null", None),
        ("camera", "refine_poses", True, "on"),
        ("data_root", "adt", "null", None),
        ("data_root", "adt", "5", "5"),
        ("query", "canonical", ["5", "null"], ["5", "null"]),
    ],
)
def test_a_text_is_read_as_the_key_wants_it(section, key, text, value):
    """Snakemake passes strings for numbers, booleans and null; keys of variants, too."""
    found = config.resolve({section: {key: text}}, PRESETS)[section][key]
    assert found == value and type(found) is type(value)
    if section not in ("data_root", "query"):
        variant = config.resolve({"variants": {"mine": {section: {key: text}}}}, PRESETS)
        assert variant_config(variant, "mine", "scene")[section][key] == value


def test_the_reference_page_is_that_of_the_schema():
    page = (ROOT / "config" / "reference.md").read_text(encoding="utf-8")
    assert page == keys_page() + "\n", "write it again: egosplat keys > config/reference.md"


def test_the_reference_page_holds_every_key_once_under_its_section():
    first, *sections = re.split(r"^## ", keys_page(), flags=re.MULTILINE)[1:]
    found: dict[str, list[str]] = {}
    for part in sections:
        section = part.splitlines()[0].removeprefix("Readings: ")
        found.setdefault(section, []).extend(re.findall(r"^\| `([^`]+)` \|", part, re.MULTILINE))
    expected = {"general": sorted(keys_of(GeneralOptions))}
    expected |= {name: sorted(f"{name}.{key}" for key in config.section_keys(name)) for name in SECTIONS}
    assert {section: sorted(paths) for section, paths in found.items()} == expected
    links = re.findall(r"^\| \[`([^`]+)`\]\(#(\w+)\)", first, re.MULTILINE)
    assert [path for path, _ in links] == list(FIRST_KEYS) and len(links) == 10
    assert all(path in found[section] for path, section in links)


def test_the_paper_s_ten_sequences_are_in_the_table():
    scenes = read_scenes(config.resolve({"scenes": str(ROOT / "config" / "scenes.tsv")}, PRESETS))
    benchmarks = [(dataset, scene) for dataset, scene in scenes if dataset in ("lerf", "3d_ovs")]
    assert len(benchmarks) == 9 and not any(is_own(scenes.pop(key)) for key in benchmarks)
    scenes = {key: scene for key, scene in scenes.items() if not scene.by_name}
    assert list(scenes) == [(dataset, f"scene{i}") for dataset in ("adt", "hoi4d") for i in range(1, 6)]
    assert all(scenes["adt", f"scene{i}"].synthetic for i in range(1, 6))
    assert len({scene.config["synthetic"]["seed"] for scene in scenes.values() if scene.synthetic}) == 5
    assert scenes["adt", "scene4"].recording == Path("results/adt/scene4/recording")


@pytest.mark.parametrize(
    "recording, root, synthetic, path",
    [
        ("some_sequence", "/data/adt", False, "/data/adt/some_sequence"),
        ("some_sequence", None, True, "results/adt/scene6/recording"),
        ("-", "/data/adt", True, "results/adt/scene6/recording"),
        ("-", None, True, "results/adt/scene6/recording"),
    ],
)
def test_a_root_replaces_a_synthetic_recording_but_no_absent_one(tmp_path, recording, root, synthetic, path):
    row = f"# a note\nadt\tscene6\tadt\t{recording}\tsynthetic.seed=7 frames.stride=3 frames.end_s=2.5\n"
    scene = scenes_of(tmp_path, HEADER + row, data_root={"adt": root})["adt", "scene6"]
    assert (scene.synthetic, scene.by_name, scene.recording) == (synthetic, recording == "-", Path(path))
    assert scene.config["frames"]["stride"] == 3 and scene.config["frames"]["end_s"] == 2.5


def test_a_format_has_keys_of_its_own_between_the_preset_and_the_row(tmp_path):
    """HOI4D under the preset paper: its threshold and its width, unless the configuration or the row says otherwise."""
    rows = "adt\ts\tadt\tr\t\nmine\th\thoi4d\tr\t\nmine\ti\thoi4d\tr\tmasks.threshold=0.3\n"

    def found(**user):
        scenes = scenes_of(tmp_path, HEADER + rows, preset="paper", **user)
        return [(s.config["frames"]["resolution"], s.config["masks"]["threshold"]) for s in scenes.values()]

    assert found() == [(1408, 0.02), (1889, 0.1), (1889, 0.3)]
    assert found(frames={"resolution": 512}) == [(512, 0.02), (512, 0.1), (512, 0.3)]
    own = {"hoi4d": {"masks": {"threshold": "2e-1"}}}
    assert found(masks={"threshold": 0.5}, formats=own) == [(1408, 0.5), (1889, 0.2), (1889, 0.3)]


def test_each_artifact_of_the_table_of_stages_has_a_schema():
    assert [*SCHEMAS] == [name for name, stage in STAGES.items() if stage.output.endswith(".zarr")]
