"""Any configuration and any table of scenes is either read, or refused in a line or two; nothing else happens."""

import math
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from egosplat.doctor.inputs import read_configuration
from egosplat.errors import UserError
from egosplat.pipeline import config
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.options import LARGEST_INTEGER, keys_of
from egosplat.pipeline.scenes import check_recording, read_scenes
from tests.support import HEADER, PRESETS
from tests.support.tables import scenes_of

SECTIONS = [*keys_of(GeneralOptions), *config.section_options()]
KEYS = [(section, name) for section in config.section_options() for name in config.section_keys(section)]

ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=200),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text() | st.integers(), inner, max_size=3),
    max_leaves=8,
)
few = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def refusal(error: UserError) -> str:
    text = str(error)
    assert text.count("\n") <= 1 and len(text) < 1500, text[:3000]
    return text


@few
@given(key=st.sampled_from(KEYS), value=ANY)
def test_any_value_of_any_key_is_allowed_or_named(key, value):
    section, name = key
    try:
        resolved = config.resolve({section: {name: value}}, PRESETS)
    except UserError as error:
        assert section in refusal(error)
    else:
        read = value if resolved[section][name] == value else yaml.safe_load(value)
        assert resolved[section][name] == read
        assert not isinstance(value, float) or math.isfinite(value)
        assert not isinstance(value, int) or abs(value) <= LARGEST_INTEGER


@few
@given(tree=st.dictionaries(st.sampled_from([*SECTIONS, "nothing", ""]), ANY, max_size=2))
def test_any_tree_of_keys_is_resolved_or_rejected(tree):
    try:
        config.resolve(tree, PRESETS)
    except UserError as error:
        refusal(error)


@few
@given(
    content=st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode("utf-8", "replace"))
)
def test_any_configuration_file_is_read_or_named(tmp_path, content):
    (tmp_path / "mine.yaml").write_bytes(content)
    try:
        read_configuration([tmp_path / "mine.yaml"], [])
    except UserError as error:
        refusal(error)


CELL = st.text(max_size=30) | st.sampled_from(
    ["", "adt", "plain", "a/b", "..", "$(x)", '"', "a\0b", "#", "\n"]
)


@few
@given(rows=st.lists(st.lists(CELL, min_size=4, max_size=6), max_size=3))
def test_any_table_of_scenes_is_read_or_named(tmp_path, rows):
    path = tmp_path / "scenes.tsv"
    text = HEADER + "".join("\t".join(row) + "\n" for row in rows)
    path.write_text(text, encoding="utf-8", errors="replace", newline="")
    try:
        scenes = read_scenes(config.resolve({"scenes": str(path)}, PRESETS))
    except UserError as error:
        assert "scenes.tsv" in refusal(error)
        return
    for dataset, scene in scenes:
        assert not set(f"{dataset}{scene}") & set("/.$;`'\" \n\t\0")


@few
@given(
    options=st.text(max_size=40)
    | st.tuples(st.sampled_from(KEYS), st.text(max_size=20)).map(
        lambda one: f"{one[0][0]}.{one[0][1]}={one[1]}"
    )
)
def test_any_options_are_parsed_or_named(options):
    try:
        parsed = config.parse_options(options, "scenes.tsv, line 2")
    except UserError as error:
        assert "scenes.tsv, line 2" in refusal(error)
    else:
        assert all(isinstance(keys, dict) for keys in parsed.values())


@pytest.mark.parametrize("content", ["[" * 5000, "{a: " * 5000, "a: 2020-99-99", "a: *b", "\0", "{[1]: 2}"])
def test_ambiguous_yaml_is_named(tmp_path, content):
    (tmp_path / "mine.yaml").write_text(content)
    with pytest.raises(UserError, match="mine.yaml"):
        config.read_yaml(tmp_path / "mine.yaml")
    with pytest.raises(UserError, match="line 2"):
        config.parse_options(f"frames.stride={content.replace(' ', '')}\0", "line 2")


def test_a_recording_may_hold_what_a_comment_begins_with(tmp_path):
    text = f"{HEADER}# all mine\n\n   \n # mine\n\t\t\nmine\ts1\tplain\twalk #1.mp4\tframes.stride=2\n"
    scene = scenes_of(tmp_path, text)["mine", "s1"]
    assert scene.recording == Path("walk #1.mp4") and scene.config["frames"]["stride"] == 2


@pytest.mark.parametrize(
    "row, message",
    [
        ("# one\n\nmine\ts1\tplain", "line 4: has 3 of the 5 columns"),
        ("0\tmine\ts1\tplain\tx\t", "line 2: has 6 of the 5 columns"),
        ("mine\ts1\tplain\ta\0b\t", "recording = .* is not allowed"),
        (f"mine\ts1\tplain\t{'x' * 300}\t", "recording = .* 255 bytes"),
        ("mine\ts1\tplain\t{x}.mp4\t", "line 2: recording = .* braces"),
        ("mine\ts1\tplain\tx\tframes.stride=[", "line 2: option .* its value cannot be read"),
        ("benchmark\ts1\tplain\tx\t", "dataset = 'benchmark'"),
        ("mine\ts1\tplain\tx \t", "recording = 'x ' .*blanks"),
        ("mine\ts1\tplain\tx\tdata_root.mine=/x", "line 2: data_root holds for all scenes"),
        ("mine\ts1\tplain\tx\tformats.plain={frames:{stride:5}}", "line 2: formats holds for all"),
        ("mine\ts1\tplain\thttps://example.com/a.mp4\t", "line 2: recording = .*no URL"),
    ],
)
def test_an_invalid_row_is_named_with_its_line(tmp_path, row, message):
    with pytest.raises(UserError, match=message):
        scenes_of(tmp_path, f"{HEADER}{row}\n")
    with pytest.raises(UserError, match="scenes.tsv, line 1: has columns"):
        scenes_of(tmp_path, "")


def test_a_table_saved_by_a_spreadsheet_in_the_home_folder_is_read(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    text = "\ufeff" + (HEADER + "mine\ts1\tplain\tx\t\n").replace("\n", "\r\n")
    scenes = scenes_of(tmp_path, text)
    with pytest.raises(UserError, match="at x"):
        check_recording(scenes["mine", "s1"])
    assert list(read_scenes(config.resolve({"scenes": "~/scenes.tsv"}, PRESETS))) == [*scenes]


def test_yaml_is_read_without_running_what_it_holds(tmp_path):
    canary = tmp_path / "canary"
    command = f"!!python/object/apply:os.system ['touch {canary}']"
    for text in (f"a: {command}", f"frames: {{stride: {command}}}"):
        (tmp_path / "mine.yaml").write_text(text)
        with pytest.raises(UserError, match="mine.yaml"):
            read_configuration([tmp_path / "mine.yaml"], [])
    assert not canary.exists()


def test_a_recording_with_an_odd_name_is_an_input(one_scene, tmp_path):
    recording = tmp_path / "walk [1-3] $(touch canary); 'it'"
    recording.mkdir()
    for name in ("1.png", "camera.json"):
        (recording / name).touch()
    done = one_scene("plain", recording).snakemake("--dry-run", "--", "results/mine/scene/frames.zarr")
    assert done.returncode == 0, done.stderr
    assert f"input: {recording}" in done.stdout + done.stderr
    assert not list(tmp_path.rglob("canary"))


def test_numbers_of_the_command_line_and_with_an_exponent_are_numbers(one_scene, tmp_path):
    (pictures := tmp_path / "pictures").mkdir()
    for number in range(6):
        Image.new("RGB", (64, 48), (40 * number, 100, 0)).save(pictures / f"{number}.png")
    workdir = one_scene("plain", pictures)
    (workdir.folder / "tiny.yaml").write_text("poses: {meters_per_unit: 1e-4}\n")
    options = ["--config", "frames={stride: 2, upright: false, end_s: null}", "poses={min_registered: 0.7}"]
    target = "results/mine/scene/poses.zarr"
    done = workdir.snakemake("--dry-run", "--printshellcmds", *options, "--", target)
    assert done.returncode == 0, done.stderr
    commands = done.stdout + done.stderr
    for value in ('"stride": 2,', '"upright": false', '"min_registered": 0.7,', '"meters_per_unit": 0.0001,'):
        assert value in commands
    assert '"end_s": null' in commands
