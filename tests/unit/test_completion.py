"""The shell completes commands, flags and choices, as docs/index.md says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


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
