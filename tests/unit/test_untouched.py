"""The apartments for reporting: no default or threshold may be chosen by their scores."""

import re
import subprocess
from pathlib import Path

import pytest

from egosplat.evaluation.scored_scenes import UNTOUCHED
from egosplat.pipeline import config
from egosplat.pipeline.scenes import Scene, read_scenes

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "config" / "scenes.tsv"
NAME = re.compile(r"scene(?:6|7|8|9|10)\b|scene\{[^}]*\b(?:6|7|8|9|10)\b|/scene\*|/scene\[")
"""One of them by name, among others in braces, or by a pattern that takes them along."""

CHOOSES = re.compile(r"(?:training|benchmarks|config|workflow|Makefile)(?:/|$)")
REPORTS = {
    "config/scenes.tsv",
    "config/README.md",
    "benchmarks/ablation/README.md",
    "benchmarks/instances/README.md",
    "benchmarks/language/README.md",
    "benchmarks/methods/README.md",
    "benchmarks/open_vocabulary/README.md",
    "benchmarks/presence/README.md",
    "benchmarks/real_camera/README.md",
    "benchmarks/survey/README.md",
    "benchmarks/tradeoff/README.md",
    "benchmarks/transient/README.md",
}
"""Files that may name them: the table, its description, and pages of scores and costs."""


@pytest.fixture(scope="module")
def scenes() -> dict[tuple[str, str], Scene]:
    return read_scenes(config.defaults() | {"scenes": str(TABLE)})


@pytest.fixture(scope="module")
def untouched(scenes) -> list[Scene]:
    return [scenes["adt", name] for name in UNTOUCHED]


def tracked() -> list[str]:
    """The repository's text files, also where it is not a checkout."""
    done = subprocess.run(["git", "ls-files"], check=False, cwd=ROOT, capture_output=True, text=True)
    names = done.stdout.splitlines()
    if done.returncode:
        found = [path.relative_to(ROOT) for path in ROOT.rglob("*") if path.is_file()]
        names = [str(path) for path in found if not path.parts[0].startswith((".", "results", "logs"))]
    suffixes = (".py", ".yaml", ".yml", ".tsv", ".smk", ".md", ".sh", "Makefile", "Snakefile", ".toml")
    return [name for name in names if name.endswith(suffixes) and (ROOT / name).is_file()]


def test_untouched_scenes_are_made_only_by_name(scenes, untouched):
    assert all(scene.synthetic for scene in untouched)
    assert [key for key, scene in scenes.items() if scene.by_name] == [("adt", name) for name in UNTOUCHED]


def test_the_scene_table_explains_untouched_scenes():
    note = " ".join(line.strip("# ") for line in TABLE.read_text().splitlines() if line.startswith("#"))
    assert "for reporting alone" in note and "no default, threshold or design" in note


def test_untouched_scenes_differ_only_in_their_seed(scenes, untouched):
    for scene in untouched:
        seed = {"synthetic": {"seed": scene.config["synthetic"]["seed"]}}
        assert scene.config == config.merge(scenes["adt", "scene1"].config, seed)


def test_seeds_of_untouched_scenes_are_used_nowhere_else(untouched):
    seeds = {scene.config["synthetic"]["seed"] for scene in untouched}
    assert len(seeds) == len(UNTOUCHED)
    spelled = "|".join(f"{str(seed)[:-3]}[_,]?{str(seed)[-3:]}" for seed in seeds)
    number = re.compile(rf"(?<![\d_.])(?:{spelled})(?!\d)")
    named = [name for name in tracked() if number.search((ROOT / name).read_text(encoding="utf-8"))]
    assert named == ["config/scenes.tsv"]


def test_nothing_that_chooses_names_them():
    """Training, benchmarks, presets and the workflow; pages that report their scores may."""
    text = {name: (ROOT / name).read_text(encoding="utf-8") for name in tracked() if CHOOSES.match(name)}
    assert "training/README.md" in text and "benchmarks/ablation/__main__.py" in text
    assert {name for name, content in text.items() if NAME.search(content)} <= REPORTS


@pytest.mark.parametrize(
    "text", ["adt/scene6", "scene{1,2,10}/metrics.json", "results/adt/scene*", "adt/scene[0-9]"]
)
def test_seed_search_pattern_matches_names_of_untouched_scenes(text):
    assert NAME.search(text)
    assert not NAME.search("results/adt/scene{1,2,3,4,5}/metrics.json adt/scene1 scene60")
