"""What is given away beside the packages: recipes of containers, which install by one script (no image is built here), and README as
the page of the package."""

import re
import tomllib

from describing import page
from tests.support import ROOT

RECIPES = [(ROOT / "containers" / name).read_text() for name in ("Dockerfile", "egosplat.def")]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def test_recipes_and_page_name_extras_and_images_that_exist_and_the_cuda_of_pytorch():
    told = (ROOT / "docs/running.md").read_text()
    (cuda,) = re.findall(r"^cuda-toolkit==(\d+\.\d+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    for text, given in zip(RECIPES, ("${TORCH} ${EXTRA}", "{{ TORCH }} {{ EXTRA }}"), strict=True):
        assert f"/opt/egosplat/containers/install.sh {given}\n" in text and text.startswith("# Untried: ")
        assert set(re.findall(r"EXTRA=(\w+)", text + told)) <= set(EXTRAS)
        assert set(re.findall(r"nvidia/cuda:(\d+\.\d+)", text + told)) == {cuda}
    (named,) = re.findall(r"--config container=(\S+)", told)
    assert f"apptainer build {named} containers/egosplat.def" in told


def test_nothing_made_goes_into_the_image():
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert {".git", ".venv", ".snakemake", "logs", "results"} <= set(ignored)


def test_links_of_readme_are_those_of_the_version_in_the_repository_or_their_text():
    readme, address = (ROOT / "README.md").read_text(encoding="utf-8"), "https://git.invalid/egosplat"
    shown, alone = page(readme, address, "1.2"), page(readme, "", "1.2")
    own = re.findall(rf"\]\({address}/(?:blob|raw)/v1\.2/([^)#]*)", shown)
    assert "docs/query.png" in own and all((ROOT / path).is_file() for path in own) and "<!--" not in shown
    targets = [re.findall(r"\]\(([^)]*)\)", text) for text in (shown, alone)]
    assert len(own) + len(targets[1]) == len(targets[0]) == readme.count("](")
    assert all(target.startswith("https://") for both in targets for target in both) and "![" not in alone
