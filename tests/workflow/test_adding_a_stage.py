"""The blocks of docs/adding_a_stage.md make a stage that runs."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import ROOT, Workdir
from tests.support.scenes import put

PAGE = ROOT / "docs/adding_a_stage.md"
CODE = {
    "src/egosplat/frames/brightness_stage.py",
    "src/egosplat/pipeline/stages.toml",
    "src/egosplat/frames/options.py",
    "workflow/rules/frames.smk",
}
TARGET = "results/mine/scene/brightness.json"
VARIANT = "results/mine/scene/variants/dim/brightness.json"
CHECKS = (
    "tests/unit/test_layers.py",
    "tests/unit/pipeline/test_config.py::test_the_record_and_the_function_of_a_stage_name_the_same_paths_and_options",
    "tests/unit/pipeline/test_config.py::test_every_key_has_a_description_and_a_default",
    "tests/unit/pipeline/test_config.py::test_the_reference_page_is_that_of_the_schema",
    "tests/unit/test_documentation.py::test_the_architecture_lists_the_stages_of_the_pipeline",
    "tests/unit/pipeline/test_costs.py",
    "tests/workflow/test_profiles.py",
)


def blocks() -> list[tuple[str, str, str]]:
    """File, language and content of each block of the page that names a file."""
    return re.findall(
        r"^\*\*`([^`]+)`\*\*\n\n```(\w+)\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL
    )


def apply(folder: Path) -> None:
    """Apply the page's blocks to a copy of the repository."""
    for name, language, content in blocks():
        path = folder / name
        if language != "diff":
            assert not path.exists(), name
            path.write_text(content)
            continue
        lines = content.splitlines(keepends=True)
        old = "".join(line[1:] for line in lines if not line.startswith("+"))
        text = path.read_text()
        assert ("\n" + text).count("\n" + old) == 1, f"{name}: the page's context is not there once: {old}"
        path.write_text(text.replace("\n" + old, "\n" + "".join(line[1:] for line in lines)))


class Checkout(Workdir):
    """A copy of the repository, with the frames of one small scene."""

    snakefile = Path("workflow/Snakefile")

    def python(self, *words: str) -> str:
        """Standard output of a Python program in the copy; the test fails when the program fails."""
        done = subprocess.run(
            [sys.executable, *words],
            check=False,
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def codes(self) -> dict[str, str]:
        """The code hash of each stage."""
        program = "import json; from egosplat.pipeline.stages import STAGES, code_of;"
        return json.loads(
            self.python("-c", program + "print(json.dumps({name: code_of(name) for name in STAGES}))")
        )


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    listed = subprocess.run(["git", "ls-files", "-z"], check=False, cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("this is no git checkout: its tracked files are not known")
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tmp_path / name)
    # Each of its processes would compile the code again.
    for compiled in (ROOT / "src").rglob("__pycache__"):
        shutil.copytree(compiled, tmp_path / compiled.relative_to(ROOT))
    (tmp_path / "recording").mkdir()
    header = "dataset\tscene\tformat\trecording\toptions\n"
    (tmp_path / "mine.tsv").write_text(f"{header}mine\tscene\tplain\trecording\t\n")
    (tmp_path / "tiny.yaml").write_text("scenes: mine.tsv")
    rgb = np.repeat(np.arange(0, 240, 20, dtype=np.uint8), 8 * 8 * 3).reshape(-1, 8, 8, 3)
    put(tmp_path / "results/mine/scene", "frames", {"rgb": rgb}, {"format": "plain", "upright": True})
    return Checkout(tmp_path)


def test_a_stage_is_four_files_of_code():
    """The page's number of files does not grow unnoticed; documentation is one row and a generated page."""
    assert {name for name, _, _ in blocks()} - {"docs/architecture.md"} == CODE
    assert len(blocks()) == len(CODE) + 1


@pytest.mark.slow
def test_the_page_makes_a_stage_that_runs(checkout):
    """Its command, checks, target, provenance, staleness and variants are there, and no other stage changes."""
    before = checkout.codes()
    apply(checkout.folder)
    (checkout.folder / "config/reference.md").write_text(checkout.python("-m", "egosplat.cli", "keys"))
    assert "dark_level" in checkout.python("-m", "egosplat.cli", "brightness", "--help")
    checkout.python("-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *CHECKS)
    after = checkout.codes()
    assert {name: after[name] for name in before} == before and set(after) - set(before) == {"brightness"}

    checkout.run(TARGET)
    document = json.loads((checkout.folder / TARGET).read_text())
    assert document["levels"] == list(range(0, 240, 20)) and document["dark"] == [0, 1]
    assert document["provenance"]["options"] == {"dark_level": 40.0}
    assert set(document["provenance"]["inputs"]) == {"frames.zarr"}

    assert checkout.stale(TARGET) == set()
    assert checkout.stale(TARGET, config="brightness: {dark_level: 60}") == {"brightness"}
    assert checkout.stale(VARIANT, config="variants: {dim: {brightness: {dark_level: 60}}}") == {"brightness"}
    checkout.edit("frames/brightness_stage.py", "\ndef run", "\nCHANGED = 1\n\n\ndef run")
    assert checkout.stale(TARGET) == {"brightness"}
