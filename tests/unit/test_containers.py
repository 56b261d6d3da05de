"""The recipes of containers agree with each other and with the repository. No image is built here."""

import re
import shlex
import tomllib

from tests.support import ROOT

DOCKER = (ROOT / "containers/Dockerfile").read_text()
APPTAINER = (ROOT / "containers/egosplat.def").read_text()
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
INSTRUCTIONS = {"ARG", "FROM", "ENV", "RUN", "WORKDIR", "COPY", "ENTRYPOINT", "CMD"}


def instructions() -> list[tuple[str, str]]:
    """Instructions of the Dockerfile with their arguments, continued lines joined."""
    lines = re.sub(r"\\\n", " ", DOCKER).splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line and not line.startswith("#")]


def packages(text: str) -> list[str]:
    words = shlex.split(re.search(r"apt-get install (.*?)(?:&&|\n|$)", text)[1])
    return [word for word in words if not word.startswith("--")]


def test_the_dockerfile_has_known_instructions_in_a_valid_order():
    found = [name for name, _ in instructions()]
    assert set(found) <= INSTRUCTIONS
    assert found[:2] == ["ARG", "FROM"] and found.count("FROM") == 1
    # An argument before FROM is not known after it.
    known = {value.partition("=")[0] for name, value in instructions()[2:] if name == "ARG"}
    used = {key for name, value in instructions()[2:] for key in re.findall(r"\$\{(\w+)\}", value)}
    assert used <= known | {"PATH"}


def test_both_recipes_install_the_same():
    (run,) = [value for name, value in instructions() if name == "RUN" and "apt-get" in value]
    post = re.search(r"^%post\n((?:    .*\n|\n)*)", APPTAINER, re.MULTILINE)[1]
    assert packages(run) == packages(post) == sorted(packages(run))
    for text in (DOCKER, APPTAINER):
        assert "make install" in text and "BASE=ubuntu:24.04" in text and "EXTRA=export" in text
    assert re.search(r"^install:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_recipes_and_page_name_extras_and_images_that_exist_and_nothing_made_goes_into_the_image():
    page = (ROOT / "docs/running.md").read_text()
    assert set(re.findall(r"EXTRA=(\w+)", DOCKER + APPTAINER + page)) <= set(EXTRAS)
    (named,) = re.findall(r"--config container=(\S+)", page)
    assert f"apptainer build {named} containers/egosplat.def" in page
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert {".git", ".venv", ".snakemake", "logs", "results"} <= set(ignored)
