"""Both recipes of containers install by one script, which names what is there. No image is built here."""

import re
import tomllib

from tests.support import ROOT

RECIPES = [(ROOT / "containers" / name).read_text() for name in ("Dockerfile", "egosplat.def")]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def test_recipes_and_page_name_extras_and_images_that_exist_and_the_cuda_of_pytorch():
    page = (ROOT / "docs/running.md").read_text()
    (cuda,) = re.findall(r"^cuda-toolkit==(\d+\.\d+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    for text, given in zip(RECIPES, ("${TORCH} ${EXTRA}", "{{ TORCH }} {{ EXTRA }}"), strict=True):
        assert f"/opt/egosplat/containers/install.sh {given}\n" in text and text.startswith("# Untried: ")
        assert set(re.findall(r"EXTRA=(\w+)", text + page)) <= set(EXTRAS)
        assert set(re.findall(r"nvidia/cuda:(\d+\.\d+)", text + page)) == {cuda}
    (named,) = re.findall(r"--config container=(\S+)", page)
    assert f"apptainer build {named} containers/egosplat.def" in page


def test_nothing_made_goes_into_the_image():
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert {".git", ".venv", ".snakemake", "logs", "results"} <= set(ignored)
