"""The validation apartments: tuning apartments with other seeds, made by name alone; no model is trained on them."""

import re
import subprocess
from collections import Counter

import pytest

from egosplat.pipeline import config
from egosplat.pipeline.scenes import Scene, read_scenes
from egosplat_apartments.world.world import make_world
from egosplat_rivals.scored_scenes import VALIDATION
from tests.support import ROOT

NAME = re.compile(r"scene(?:6|7|8|9|10)\b|scene\{[^}]*\b(?:6|7|8|9|10)\b|/scene\*|/scene\[")


@pytest.fixture(scope="module")
def scenes() -> dict[tuple[str, str], Scene]:
    return read_scenes(config.resolve({"scenes": str(ROOT / "config/scenes.tsv")}, ROOT / "config/presets"))


@pytest.fixture(scope="module")
def validation(scenes) -> list[Scene]:
    return [scenes["adt", name] for name in VALIDATION]


def tracked() -> list[str]:
    """The repository's text files."""
    done = subprocess.run(["git", "ls-files"], check=True, cwd=ROOT, capture_output=True, text=True)
    suffixes = (".py", ".yaml", ".yml", ".tsv", ".smk", ".md", ".sh", "Makefile", "Snakefile", ".toml")
    return [name for name in done.stdout.splitlines() if name.endswith(suffixes) and (ROOT / name).is_file()]


def test_validation_scenes_are_made_only_by_name(scenes, validation):
    assert all(scene.synthetic for scene in validation)
    others = {f"{world}{number}" for world in ("busy", "foreign") for number in range(1, 6)}
    assert {name for (_, name), scene in scenes.items() if scene.by_name} == {*VALIDATION, *others}


def test_validation_scenes_differ_only_in_their_seed(scenes, validation):
    for scene in validation:
        seed = {"synthetic": {"seed": scene.config["synthetic"]["seed"]}}
        assert scene.config == config.merge(scenes["adt", "scene2"].config, seed)


def test_in_the_first_scene_two_people_put_things_down_at_several_places(scenes):
    keys = scenes["adt", "scene1"].config["synthetic"]
    world = make_world(**{name: keys[name] for name in ("seed", "seconds", "objects", "motion", "world")})
    places = Counter(rest.instance_id for rest in world.rests(keys["seconds"]))
    assert len(world.people) == 2 and len(places) >= 2 and min(places.values()) >= 3


def test_seeds_of_validation_scenes_are_used_nowhere_else(validation):
    seeds = {scene.config["synthetic"]["seed"] for scene in validation}
    assert len(seeds) == len(VALIDATION)
    spelled = "|".join(f"{str(seed)[:-3]}[_,]?{str(seed)[-3:]}" for seed in seeds)
    number = re.compile(rf"(?<![\d_.])(?:{spelled})(?!\d)")
    named = [name for name in tracked() if number.search((ROOT / name).read_text(encoding="utf-8"))]
    assert named == ["config/scenes.tsv"]


def test_training_does_not_name_them():
    names = [name for name in tracked() if name.startswith("training/")]
    assert "training/README.md" in names
    assert [name for name in names if NAME.search((ROOT / name).read_text(encoding="utf-8"))] == []
