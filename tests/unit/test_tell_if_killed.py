"""A stage that could say nothing itself: what the workflow's shell says for it."""

import shlex
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "workflow/scripts/tell_if_killed.sh"


@pytest.mark.parametrize(
    "status, limit, told",
    [
        (137, "unlimited", "killed, most likely for lack of memory"),
        (137, "4000000", "killed, most likely for lack of memory"),
        (139, "4000000", "crashed, most likely because ulimit -v allows 4000000 KiB"),
        (134, "4000000", "crashed, most likely because ulimit -v allows 4000000 KiB"),
        (139, "unlimited", ""),  # a defect, which no advice should hide
        (2, "4000000", ""),
        (0, "unlimited", ""),
    ],
)
def test_a_killed_or_crashed_stage_is_explained(status, limit, told):
    limited = f"ulimit -v {limit}; sh {shlex.quote(str(SCRIPT))} {status}"
    done = subprocess.run(["sh", "-c", limited], capture_output=True, text=True, check=True)
    assert told in done.stderr and bool(told) == bool(done.stderr) and done.stdout == ""
