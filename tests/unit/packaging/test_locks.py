"""The pinned libraries: they fit the ranges of pyproject.toml, and running needs no more of them than it says."""

import re
import subprocess
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support import ROOT

ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = ABOUT["optional-dependencies"]


def pins(name: str) -> dict[str, str]:
    lines = re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / name).read_text(), re.MULTILINE)
    return {canonicalize_name(library): version for library, version in lines}


RUNNING, TESTING = pins("requirements.lock"), pins("requirements-dev.lock")


@pytest.mark.parametrize(
    "extras, found", [(("aria",), RUNNING), (("dev", "export", "clusters"), TESTING)], ids=["run", "test"]
)
def test_the_pins_fit_the_ranges(extras, found):
    for text in [*ABOUT["dependencies"], *(line for name in extras for line in EXTRAS[name])]:
        wanted = Requirement(text)
        assert wanted.specifier.contains(found[canonicalize_name(wanted.name)]), wanted


def test_tests_run_with_the_libraries_of_a_run_which_needs_neither_viewers_nor_browsers():
    assert {**TESTING, **RUNNING} == {**RUNNING, **TESTING}
    assert set(RUNNING) - set(TESTING) == {"projectaria-tools"}
    # projectaria-tools asks for the first four, tests for the last three.
    unwanted = {"rerun-sdk", "jupyterlab", "moviepy", "plotly", "playwright", "pytest", "gsplat"}
    assert not unwanted & set(RUNNING)


def test_without_cuda_none_of_its_libraries_is_installed():
    words = ("make", "--dry-run", "--always-make", "install", "TORCH=cpu")
    plan = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (left_out,) = re.findall(r"grep -vE '(.*)' requirements\.lock", plan)
    first = {name for name in RUNNING if not re.match(left_out, f"{name}==1")}
    assert not [name for name in first if name.startswith(("cuda", "nvidia", "triton", "torch"))]
    assert set(RUNNING) - first >= {"torch", "torchvision", "triton", "nvidia-cudnn-cu13", "cuda-toolkit"}
    assert re.search(r"--constraint requirements\.lock --no-deps --index-url \S+/cpu torch torchvision", plan)
