"""The front of the command line: commands by group, few flags first; the shell completes them, as docs/index.md says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from egosplat.cli import cli


def said(*words: str) -> str:
    done = CliRunner(env={"COLUMNS": "80"}).invoke(cli, words)
    assert done.exit_code == 0, done.output
    return done.output


def test_commands_are_listed_by_group_on_one_line_each():
    text = said("--help")
    order = ("Make a scene:", "Ask and look:", "  query ", "Set up:", "  doctor ", "Stages", "  splats ")
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    assert max(map(len, text.splitlines())) <= 80 and "..." not in text[places[0] :]


@pytest.mark.parametrize("command", ["query", "catalog", "page", "view", "export", "movie"])
def test_keys_stand_behind_set(command):
    text = said(command, "--help")
    assert "--set" in text and "temperature" not in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("egosplat exp", "export"),
        ("egosplat export x --for", "--format"),
        ("egosplat export x --format sp", "spz"),
    ],
)
def test_bash_completes(words, expected):
    asked = {"_EGOSPLAT_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    command = Path(sys.executable).with_name("egosplat")
    done = subprocess.run([command], env=os.environ | asked, capture_output=True, text=True, check=True)
    assert done.stdout == f"plain,{expected}\n"
