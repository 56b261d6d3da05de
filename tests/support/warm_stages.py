"""The command ``egosplat`` in processes that are forked from one that has imported the libraries of the stages.

For the scene of a test, importing PyTorch takes a stage longer than its work. The code of egosplat is imported by each call itself,
because tests edit it. Bash, which runs the commands of the rules, calls a function of the environment before a program.
"""

import atexit
import gc
import json
import os
import secrets
import select
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Any

PRELOADED = (
    *("click", "cv2", "jinja2", "matplotlib.pyplot", "numcodecs", "open_clip", "pandas", "pydantic"),
    *(
        "safetensors.torch",
        "sam2.build_sam",
        "scipy.ndimage",
        "scipy.optimize",
        "scipy.spatial",
        "scipy.stats",
    ),
    *("torch", "torchvision", "yaml", "zarr"),
)
"""What the stages import, apart from egosplat and what one of them alone needs."""

THREADS = "OMP_NUM_THREADS"
"""PyTorch reads it when it is imported, so a call with another value than one starts a process of its own."""

SET_BY_THE_COMMAND = {"OMP_WAIT_POLICY": "passive", "HF_HUB_DISABLE_TELEMETRY": "1"}
"""As in ``egosplat.cli.main``, for libraries that read them when they are imported."""


def warm_stages() -> dict[str, str]:
    """The environment in which bash calls the command ``egosplat`` of this process of the test run."""
    call = shlex.join([sys.executable, "-ISE", __file__, _server()])
    return {"BASH_FUNC_egosplat%%": f'() {{ {call} "$@"; }}'}


@cache
def _server() -> str:
    """Start the process that forks, one for each process of a test run; the name of its socket. It ends with this process."""
    name = f"egosplat-tests-{secrets.token_hex(8)}"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"\0{name}")
        listener.listen(16)
        environment = os.environ | SET_BY_THE_COMMAND | {THREADS: "1"}
        environment.pop("PYTHONPATH", None)
        handle = listener.fileno()
        words = [sys.executable, __file__, "--serve", str(handle)]
        _RUNNING.append(subprocess.Popen(words, stdin=subprocess.PIPE, env=environment, pass_fds=[handle]))
    return name


_RUNNING: list["subprocess.Popen[bytes]"] = []


def _ask(name: str, arguments: list[str]) -> int:
    """Have the server run the command with this process's streams, folder and environment; its exit status."""
    call = {"arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)}
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(f"\0{name}")
        socket.send_fds(connection, [b"."], [0, 1, 2])
        connection.sendall(json.dumps(call).encode() + b"\n")
        return int(connection.makefile().readline())


def _next_call(listener: socket.socket) -> dict[str, Any] | None:
    """Fork for each call: in the child, with the caller's streams, return it; in the server, None when its input ends."""
    while listener in select.select([listener, sys.stdin], [], [])[0]:
        connection, _ = listener.accept()
        _preload()
        if os.fork() == 0:
            listener.close()
            return _fork(connection)
        connection.close()
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass  # their processor time now counts as this process's
    return None


@cache
def _preload() -> None:
    for name in PRELOADED:
        import_module(name)
    gc.freeze()  # else each child copies and clears all that it shares


def _fork(connection: socket.socket) -> dict[str, Any]:
    """Fork: the child returns the call, its parent tells the caller how the child ends."""
    _, streams, _, _ = socket.recv_fds(connection, 1, 3)
    call = json.loads(connection.makefile().readline())
    if (child := os.fork()) == 0:
        connection.close()
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        return call
    for number in (0, 1, 2, *streams):
        os.close(number)
    handle = os.pidfd_open(child)
    if handle not in select.select([connection, handle], [], [])[0]:
        os.kill(child, signal.SIGKILL)  # as its caller was
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    connection.sendall(b"%d\n" % (status if status >= 0 else 128 - status))
    os._exit(0)


def _become(call: Mapping[str, Any]) -> None:
    """Make this process what the command ``egosplat`` is at its start."""
    os.chdir(call["folder"])
    os.environ.clear()
    os.environ.update(call["environment"])
    if os.environ.get(THREADS) != "1":
        os.execv(sys.executable, [sys.executable, "-m", "egosplat.cli", *call["arguments"]])
    sys.path[0:1] = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    tempfile.tempdir = None  # found anew, in the call's environment
    sys.dont_write_bytecode = "PYTHONDONTWRITEBYTECODE" in os.environ
    sys.argv[:] = ["egosplat", *call["arguments"]]


def _run() -> None:
    """Run the command and end without taking the libraries down, which takes longer than a small command."""
    status = 0
    try:
        import_module("egosplat.cli").main()
    except SystemExit as end:
        status = int(end.code or 0)
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__" and sys.argv[1] != "--serve":
    sys.exit(_ask(sys.argv[1], sys.argv[2:]))
elif __name__ == "__main__":
    if (call := _next_call(socket.socket(fileno=int(sys.argv[2])))) is None:
        os._exit(0)
    _become(call)
    _run()
