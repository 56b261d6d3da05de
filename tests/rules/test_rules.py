"""Each rule alone, on the inputs of a full run, makes the same output as the full run."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image, ImageChops

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.pipeline.stages import PAGES, PIPELINE, STAGES
from egosplat.pipeline.validation import read_document
from tests.conftest import ROOT

SCENE = "results/adt/scene1"
COSTS = {"created", "wall_s", "cpu_s", "peak_memory_mb", "peak_gpu_memory_mb", "training_s", "disk_mb"}
"""Keys of provenance that differ between equal runs."""

UNMADE = {"survey", "histories", "carries_sheet"}
"""A full run without ``auto`` makes no survey, and where nothing is tracked because it moves, no histories."""

OUTPUTS = {name: STAGES[name].output for name in (*PIPELINE, *PAGES) if name not in UNMADE}
"""By rule."""


def same(left: Path, right: Path) -> bool:
    if left.suffix == ".zarr":
        return verify(left, SCHEMAS).digest == verify(right, SCHEMAS).digest
    if left.suffix == ".json":
        return without_costs(json.loads(left.read_text())) == without_costs(json.loads(right.read_text()))
    if left.is_dir():
        return same_folder(left, right)
    if left.suffix == ".html":
        # The page is compressed, so that a last bit of a rendered share changes many bytes, and hardly the size.
        sizes = [path.stat().st_size for path in (left, right)]
        return max(sizes) < 1.02 * min(sizes)
    # PyTorch rounds the last bit by how its arrays lie in memory, so a rendered pixel may differ by a level or two.
    difference = ImageChops.difference(Image.open(left).convert("RGB"), Image.open(right).convert("RGB"))
    return max(high for _, high in difference.getextrema()) <= 2


def without_costs(value: Any) -> Any:
    if isinstance(value, list):
        return [without_costs(one) for one in value]
    if isinstance(value, dict):
        return {key: without_costs(one) for key, one in value.items() if key not in COSTS}
    return value


def same_folder(left: Path, right: Path) -> bool:
    def files(folder: Path) -> list[Path]:
        return sorted(
            f.relative_to(folder) for f in folder.rglob("*") if f.is_file() and not f.name.startswith(".")
        )

    return files(left) == files(right) and all(
        (left / file).read_bytes() == (right / file).read_bytes() for file in files(left)
    )


# No page is an input of another rule, so one run makes all of them.
ALONE = [(rule,) for rule in OUTPUTS if rule not in (*PAGES, "synthetic", "segments")]
LONG = [("synthetic",), ("segments",), tuple(name for name in PAGES if name in OUTPUTS)]
ALONE += [pytest.param(rules, marks=pytest.mark.slow) for rules in LONG]


@pytest.mark.parametrize("rules", ALONE, ids=lambda rules: rules[0] if len(rules) == 1 else "pages")
def test_a_rule_alone_makes_the_output_of_the_full_run(rules, finished, workdir):
    targets = [workdir.folder / SCENE / OUTPUTS[rule] for rule in rules]
    for target in targets:
        shutil.rmtree(target) if target.is_dir() else target.unlink()
    wanted = [f"{SCENE}/{target.name}" for target in targets]
    done = workdir.snakemake("--allowed-rules", *rules, "--", *wanted)
    assert done.returncode == 0, done.stdout + done.stderr
    for target in targets:
        assert same(finished.folder / SCENE / target.name, target), target.name


def run_rules(workdir, rules: tuple[str, ...], config: str, *targets: str) -> None:
    """Make targets by these rules alone, with additional configuration."""
    (workdir.folder / "more.yaml").write_text(config)
    wanted = [f"{SCENE}/{target}" for target in targets]
    done = workdir.snakemake("more.yaml", "--allowed-rules", *rules, "--", *wanted)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_a_method_that_learns_from_tiles_is_scored_without_instances(workdir):
    for name in ("segments", "instances", "view_features", "features"):
        shutil.rmtree(workdir.folder / SCENE / f"{name}.zarr")
    rules = ("frames", "poses", "annotations", "tiles", "splats", "language", "metrics")
    # Two of five frames are left for training: each has 881 tiles.
    config = """
frames: {end_s: 2.5}
splats: {masking: none}
language: {method: field, iterations: 10, pixels: 50}
"""
    pages = ("queries_sheet", "splats_sheet", "story")
    run_rules(workdir, (*rules, *pages), config, "metrics.json", "queries.png", "story.html")
    assert not (workdir.folder / SCENE / "instances.zarr").exists()
    tiles, found = (
        verify(workdir.folder / SCENE / f"{name}.zarr", SCHEMAS) for name in ("tiles", "language")
    )
    assert found.facts["method"] == "field" and found.provenance["inputs"]["tiles.zarr"] == tiles.digest
    assert found.has("decoder/values") and len(found.facts["levels"]) == 8
    scored = json.loads((workdir.folder / SCENE / "metrics.json").read_text())
    made_from = {f"{name}.zarr" for name in ("frames", "poses", "annotations", "tiles", "splats", "language")}
    assert set(scored["artifacts"]) == made_from and len(scored["queries"]) > 0


def test_carries_are_found_and_drawn_in_a_finished_scene(workdir):
    """Nothing asks for them where nothing is tracked because it moves; by name, they are made from what is there."""
    run_rules(workdir, ("histories", "carries_sheet"), "{}", "histories.zarr", "carries.png")
    histories, splats = (
        verify(workdir.folder / SCENE / f"{name}.zarr", SCHEMAS) for name in ("histories", "splats")
    )
    assert histories.provenance["inputs"]["splats.zarr"] == splats.digest
    assert histories.shape("carries/feature")[0] == histories.shape("carries/start")[0]
    assert Image.open(workdir.folder / SCENE / "carries.png").width > 700
    assert workdir.stale(f"{SCENE}/histories.zarr", f"{SCENE}/carries.png") == set()


@pytest.mark.slow
def test_methods_are_drawn_side_by_side(workdir):
    config = """
variants: {mine: {method: Mine, language: {method: center}}}
tables: {methods: [mine]}
"""
    run_rules(workdir, ("language", "metrics", "methods_sheet"), config, "methods.png")
    wide = Image.open(workdir.folder / SCENE / "methods.png").width
    assert workdir.stale(f"{SCENE}/methods.png", config=config) == set()
    more = config.replace(
        "variants: {", "variants: {other: {extends: mine, method: Other, language: {lr: 0.1}}, "
    ).replace("[mine]", "[mine, other]")
    assert workdir.stale(f"{SCENE}/methods.png", config=more) == {"language", "metrics", "methods_sheet"}
    run_rules(workdir, ("language", "metrics", "methods_sheet"), more, "methods.png")
    assert Image.open(workdir.folder / SCENE / "methods.png").width == pytest.approx(4 / 3 * wide, rel=0.02)


def test_the_survey_alone_decides_from_frames_and_poses(workdir):
    for stage in set(STAGES) - {"synthetic", "frames", "poses"}:
        output = workdir.folder / SCENE / STAGES[stage].output
        shutil.rmtree(output) if output.is_dir() else output.unlink(missing_ok=True)
    run_rules(workdir, ("survey",), "splats: {masking: auto}", "survey.json")
    found = read_document(workdir.folder / SCENE / "survey.json", "survey")
    assert found["motion"]["masking"] == "refined"


@pytest.mark.slow
def test_the_tables_alone_show_the_scores_of_every_scene(workdir):
    (workdir.folder / "config/scenes.tsv").write_text((ROOT / ".test/config/scenes.tsv").read_text())
    variants = {name: {} for name in ("baseline", "no_masks", "network_masks")}
    (workdir.folder / "more.yaml").write_text(
        yaml.safe_dump({"variants": variants, "tables": {"methods": []}})
    )
    tables = workdir.folder / "results/benchmark"
    done = workdir.snakemake("more.yaml", "--allowed-rules", "tables", "--", "results/benchmark/tables.html")
    assert done.returncode == 0, done.stdout + done.stderr
    scores = json.loads((workdir.folder / SCENE / "metrics.json").read_text())["scores"]["all"]
    table = pd.read_csv(tables / "adt_accuracy.csv")
    own = table[(table["method"] == "EgoSplat") & (table["group"] == "all")]["percent"]
    assert np.isclose(own, 100 * scores["accuracy"], atol=0.06).any()


@pytest.mark.slow
def test_the_tradeoff_of_scenes_joins_them(workdir):
    config = """
tradeoff: {variants: [], scenes: [adt/scene1]}
"""
    run_rules(workdir, ("tradeoff",), config, "tradeoff/tradeoff.html")
    assert set(pd.read_csv(workdir.folder / SCENE / "tradeoff/tradeoff.csv")["point"]) == {"the scene"}
    (workdir.folder / "more.yaml").write_text(config)
    target = "results/benchmark/tradeoff.html"
    done = workdir.snakemake("more.yaml", "--allowed-rules", "tradeoff_scenes", "--", target)
    assert done.returncode == 0, done.stdout + done.stderr
    joined = pd.read_csv(workdir.folder / "results/benchmark/tradeoff.csv")
    assert set(joined["scene"]) == {"adt/scene1"} and (workdir.folder / target).stat().st_size > 1000
