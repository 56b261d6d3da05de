"""Each rule alone, on the inputs of a full run, makes the same output as the full run."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from PIL import Image, ImageChops

from egosplat.artifacts.reader import verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.pipeline.stages import PAGES, PIPELINE, STAGES

SCENE = "results/adt/scene1"
COSTS = {"created", "wall_s", "cpu_s", "peak_memory_mb", "peak_gpu_memory_mb", "training_s", "disk_mb"}
"""Keys of provenance that differ between equal runs."""

OUTPUTS = {name: STAGES[name].output for name in (*PIPELINE, *PAGES) if name != "survey"}
"""By rule; a full run without ``auto`` makes no survey."""


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
ALONE = [(rule,) for rule in OUTPUTS if rule not in PAGES] + [tuple(PAGES)]


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


def test_tiles_are_made_for_a_method_that_learns_from_them(workdir):
    (workdir.folder / "field.yaml").write_text("language: {method: field, iterations: 10, pixels: 50}")
    target = f"{SCENE}/language.zarr"
    done = workdir.snakemake(
        "--allowed-rules", "tiles", "language", "--configfile", "tiny.yaml", "field.yaml", "--", target
    )
    assert done.returncode == 0, done.stdout + done.stderr
    tiles, found = (
        verify(workdir.folder / SCENE / f"{name}.zarr", SCHEMAS) for name in ("tiles", "language")
    )
    assert found.facts["method"] == "field" and found.provenance["inputs"]["tiles.zarr"] == tiles.digest
    assert found.has("decoder/values") and len(found.facts["levels"]) == 8
