"""A stage ends when its Snakemake has died, and only then."""

import os
import subprocess
import sys
import time

from egosplat.pipeline.process_guards import STARTED_BY

STAGE = """
import time
from egosplat.pipeline.process_guards import end_with_snakemake
from egosplat.progress import show_log
show_log()
end_with_snakemake()
print("begun", flush=True)
time.sleep(600)
"""


def stage(started_by: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", STAGE],
        env=os.environ | {STARTED_BY: started_by},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    return process


def test_a_stage_exits_with_its_snakemake():
    snakemake = subprocess.Popen(["sleep", "600"])
    process = stage(str(snakemake.pid))
    time.sleep(0.2)
    assert process.poll() is None
    snakemake.kill()
    snakemake.wait()
    assert process.wait(timeout=120) == 1
    assert "continues from here" in process.stderr.read()


def test_a_stage_without_snakemake_keeps_running():
    processes = [stage(started_by) for started_by in ("", "rubbish", str(os.getpid()))]
    time.sleep(1.5)
    for process in processes:
        assert process.poll() is None
        process.kill()
        process.wait()
