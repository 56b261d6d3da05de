"""How to make a point, as the page tells it."""

from dataclasses import replace
from pathlib import Path

from egosplat.pipeline.config import merge, resolve
from egosplat.pipeline.scenes import read_scenes
from egosplat.pipeline.sweeps import recipe_of, with_points

ROOT = Path(__file__).resolve().parents[3]
PRESETS = ROOT / "config" / "presets"


def scene(monkeypatch, preset: str = "balanced"):
    """adt/scene1 with the points of the trade-off."""
    monkeypatch.chdir(ROOT)
    found = read_scenes(resolve({"preset": preset}, PRESETS))["adt", "scene1"]
    return replace(found, config=with_points(found.config, PRESETS, found.format))


def test_a_recipe_gives_the_preset(monkeypatch):
    """The keys of a recipe, set over the defaults, are the preset."""
    recipe = recipe_of(scene(monkeypatch), "draft")
    sections: dict = {}
    for key, value in recipe["keys"].items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    wanted, found = resolve({"preset": "draft"}, PRESETS), resolve(sections, PRESETS)
    # A key that is set wins over a format's; that of a preset does not.
    assert merge(found, {"preset": "draft", "formats": wanted["formats"]}) == wanted
    assert recipe["command"] == "snakemake --cores 2 results/adt/scene1/variants/draft/metrics.json"


def test_a_recipe_holds_no_key_with_its_default_and_none_of_the_recording(monkeypatch):
    """adt/scene1 sets the seed of its apartment."""
    assert recipe_of(scene(monkeypatch), None)["keys"] == {}
    assert recipe_of(scene(monkeypatch), "splats-iterations-1500")["keys"] == {"splats.iterations": 1500}


def test_the_command_names_a_preset_other_than_the_default(monkeypatch):
    recipe = recipe_of(scene(monkeypatch, "draft"), None)
    assert recipe["command"] == "snakemake --cores 2 --config preset=draft -- results/adt/scene1/metrics.json"
    assert recipe["keys"]["frames.resolution"] == 256
