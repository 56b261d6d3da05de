"""Each stage that chooses its module by a value has a record of every value, and no import that leads to the others."""

from types import SimpleNamespace

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.code_hash import modules_of
from egosplat.pipeline.config import defaults, merge, section_keys
from egosplat.pipeline.stages import STAGES, code_of, load_module
from egosplat.pipeline.variants import chosen_value

CHOICES = {name: stage.modules for name, stage in STAGES.items() if stage.modules}
EVERY = [(stage, value) for stage, modules in CHOICES.items() for value in modules]

# The function or constant that a stage takes from the module.
TAKEN = {
    "frames": ("open_recording",),
    "annotations": ("open_annotations",),
    "poses": ("adt_poses", "known_poses", "colmap_poses"),
    "language": ("METHOD",),
}


def test_the_records_have_the_values_of_the_package():
    assert {*CHOICES["poses"]} - {"device", "known"} == {*section_keys("poses")["method"]["enum"]} - {"auto"}
    assert CHOICES["frames"].keys() == CHOICES["annotations"].keys()


@pytest.mark.parametrize("stage, value", EVERY)
def test_a_value_loads_a_module_with_what_the_stage_takes(stage, value):
    module = load_module(stage, value)
    assert module.__name__ == CHOICES[stage][value]
    assert [name for name in TAKEN[stage] if vars(module).get(name)]


@pytest.mark.parametrize("stage, value", EVERY)
def test_no_import_leads_to_the_modules_of_other_values(stage, value):
    others = {*CHOICES[stage].values()} - {CHOICES[stage][value]}
    reached = {*modules_of(STAGES[stage].module, CHOICES[stage][value])}
    # Splat Feature Solver scales its codes as LangSplat does, and benchmarks are read as plain pictures are.
    pictures = {"egosplat.frames.pictures"}
    shared = {"clustered": {"egosplat_rivals.langsplat"}, "lerf": pictures, "3d_ovs": pictures}
    assert reached & others <= shared.get(value, set())


def test_other_formats_and_methods_never_reach_colmap_and_rivals():
    for stage, value in (("frames", "adt"), ("annotations", "adt")):
        reached = modules_of(STAGES[stage].module, CHOICES[stage][value])
        assert not [name for name in reached if name.startswith("egosplat.calibration.colmap.")]
    assert not [name for name in modules_of("egosplat.language.stage") if "rivals" in name]


def test_a_value_without_a_record_is_refused():
    for use in (load_module, code_of):
        with pytest.raises(UserError, match="language.method"):
            use("language", "forgotten")


@pytest.mark.parametrize(
    "stage, format, keys, names, expected",
    [
        ("poses", "adt", {}, (), "device"),
        ("poses", "adt", {"poses": {"method": "colmap"}}, (), "colmap"),
        ("poses", "hoi4d", {}, (), "colmap"),
        ("poses", "plain", {}, (), "colmap"),
        ("poses", "plain", {}, ("transforms.json",), "known"),
        ("poses", "plain", {"frames": {"known_poses": "none"}}, ("transforms.json",), "colmap"),
        ("poses", "adt", {}, ("transforms.json",), "device"),
        ("language", "adt", {"language": {"method": "trained"}}, (), "trained"),
        ("language", "adt", {"splats": {"language": "joint"}}, (), "joint"),
        ("splats", "adt", {}, (), None),
    ],
)
def test_a_scene_chooses_by_its_recording_and_its_keys(tmp_path, stage, format, keys, names, expected):
    for name in names:
        (tmp_path / name).touch()
    scene = SimpleNamespace(format=format, recording=tmp_path)
    assert chosen_value(stage, scene, merge(defaults(), keys)) == expected
