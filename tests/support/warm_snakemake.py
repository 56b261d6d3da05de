"""Snakemake's command line in processes that are forked from one that has imported it, which halves the time of a call.

The code of egosplat is imported by each call itself, because tests edit it.
"""

import gc
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

if __name__ != "__main__":
    from tests.support.warm_stages import warm_stages

PRELOADED = ("snakemake.cli", "snakemake.storage", "jsonschema", "numpy", "smart_open")
"""What Snakemake and the workflow import, apart from egosplat."""

TIMEOUT_S = 1800


def run_snakemake(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run ``snakemake`` with arguments in a folder, with warm stages. It is killed by SIGALRM after ``TIMEOUT_S``."""
    with tempfile.NamedTemporaryFile("r") as out, tempfile.NamedTemporaryFile("r") as err:
        call = {
            "arguments": list(arguments),
            "folder": str(folder),
            "environment": {**environment, **warm_stages()},
            "outputs": [out.name, err.name],
        }
        server = _server()
        assert server.stdin is not None and server.stdout is not None
        server.stdin.write(json.dumps(call) + "\n")
        server.stdin.flush()
        status = int(server.stdout.readline())
        return subprocess.CompletedProcess(call["arguments"], status, out.read(), err.read())


@cache
def _server() -> "subprocess.Popen[str]":
    """The process that forks, one for each process of a test run. It ends when its input ends."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=clean, text=True
    )


def _next_call() -> dict[str, Any] | None:
    """Fork for each call: in the child, return it; in the server, return None at the end of the input."""
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            return json.loads(line)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)
    return None


def _become(call: Mapping[str, Any]) -> None:
    """Make this process what ``python -m snakemake`` is at its start."""
    os.chdir(call["folder"])
    os.environ.clear()
    os.environ.update(call["environment"])
    for descriptor, path in enumerate((os.devnull, *call["outputs"])):
        opened = os.open(path, os.O_RDWR)
        os.dup2(opened, descriptor)
        os.close(opened)
    sys.path[0] = call["folder"]
    sys.path[1:1] = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    sys.dont_write_bytecode = "PYTHONDONTWRITEBYTECODE" in os.environ
    sys.argv[1:] = call["arguments"]
    signal.alarm(TIMEOUT_S)


if __name__ == "__main__":
    # jsonschema would import it, which takes a second; egosplat.pipeline.validation leaves it out, too.
    sys.modules["rfc3987_syntax"] = None  # type: ignore[assignment]
    for name in PRELOADED:
        import_module(name)
    from snakemake.cli import get_argument_parser, main

    get_argument_parser()  # imports the plugins
    gc.freeze()  # else each child copies and clears all that it shares
    if (call := _next_call()) is not None:
        _become(call)
        main(call["arguments"])
