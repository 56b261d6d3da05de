"""Every benchmark's command can be imported and explains itself."""

from importlib import import_module

import pytest
from click.testing import CliRunner

from benchmarks.common import ROOT

# Commands beside the topics' own.
MORE = ("growth.masks", "instances.growth", "real_camera.still_masks")
TOPICS = sorted(path.parent.name for path in (ROOT / "benchmarks").glob("*/__main__.py"))


@pytest.mark.parametrize("name", [*(f"{topic}.__main__" for topic in TOPICS), *MORE])
def test_the_help_names_the_command(name):
    """A module that uses what the package no longer has fails at its import."""
    shown = CliRunner().invoke(import_module(f"benchmarks.{name}").main, ["--help"], terminal_width=300)
    assert shown.exit_code == 0, shown.output
    assert f"python -m benchmarks.{name.removesuffix('.__main__')}" in " ".join(shown.output.split())
