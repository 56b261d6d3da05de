"""Snakemake and the command ``egosplat`` in processes that are forked from one that has imported their libraries. For the scene of a
test, importing PyTorch takes a stage longer than its work, and importing Snakemake takes longer than a plan. The code of egosplat is
imported by each call itself, because tests edit it."""

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
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

_CHECKS = ("jsonschema", "pydantic.fields", "pydantic.json_schema", "pydantic.main", "yaml")

PRELOADED = {
    "egosplat": (
        *("click", "cv2", "jinja2", "matplotlib.pyplot", "numcodecs", "open_clip", "pandas"),
        *("safetensors.torch", "sam2.build_sam", "scipy.ndimage", "scipy.optimize", "scipy.spatial"),
        *("scipy.stats", "torch", "torchvision", "zarr", *_CHECKS),
    ),
    "snakemake": ("snakemake.cli", "snakemake.storage", "numpy", "smart_open", *_CHECKS),
}
"""What the stages, and what Snakemake and the workflow import, apart from egosplat and what one stage alone needs."""

THREADS = "OMP_NUM_THREADS"
"""PyTorch reads it when it is imported, so a call with another value than one starts a process of its own."""

SET_BY_THE_COMMAND = {"OMP_WAIT_POLICY": "passive", "HF_HUB_DISABLE_TELEMETRY": "1"}
"""As in ``egosplat`` and ``egosplat.cli.main``, for libraries that read them when they are imported."""

STAGES, PLANS = "BASH_FUNC_egosplat%%", "BASH_FUNC_snakemake%%"
JOBS, STEPS = "EGOSPLAT_TESTS_JOBS", "EGOSPLAT_TESTS_STEPS"
"""Variables: bash calls the function of a program's name before the program; commands for Python on a cluster (``on_cluster``)."""

SERVERS = "EGOSPLAT_TESTS_SERVERS"
"""Variable: the servers' names by program, where the processes of a test run share them."""

COLD = "cold"
"""In place of a server's name: the stages of a job are not warm."""

STATUS_CHECKS_S = 1.0
"""Snakemake waits 10 s longer after each check at which no job of a cluster has ended, and no option limits it."""

TIMEOUT_S = 1800


def leave_flushing() -> None:
    """Let the system write files when it likes. Each artifact waits for some 40 flushes, and no test survives a power failure."""
    os.fsync = lambda _: None


def run_snakemake(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run ``snakemake`` with arguments in a folder, with warm stages. It is killed by SIGALRM after ``TIMEOUT_S``."""
    name, called = _server("snakemake"), dict(environment) | warm_stages()
    with (
        open(os.devnull) as nothing,
        tempfile.NamedTemporaryFile("r") as out,
        tempfile.NamedTemporaryFile("r") as err,
    ):
        streams = [nothing.fileno(), *(os.open(one.name, os.O_RDWR) for one in (out, err))]
        status = _ask(name, list(arguments), str(folder), called, streams)
        for stream in streams[1:]:
            os.close(stream)
        return subprocess.CompletedProcess(list(arguments), status, out.read(), err.read())


def warm_stages() -> dict[str, str]:
    """The environment in which bash calls the command ``egosplat`` of this process of the test run."""
    return {STAGES: _function(_server("egosplat"))}


def warm_plans() -> dict[str, str]:
    """The environment in which bash calls a ``snakemake`` of this process of the test run that only plans."""
    return {PLANS: f'() {{ {_client(_server("snakemake"))} --dry-run "$@"; }}'}


def on_cluster(*, steps: bool) -> dict[str, str]:
    """The environment in which the Snakemake of a cluster's job is warm; with ``steps`` that of its step, and
    its stages, too. SLURM sees neither memory nor time of what is forked from elsewhere."""
    python = f"{_client(_server('snakemake'))} {_server('egosplat') if steps else COLD}"
    return {JOBS: python, STEPS: python if steps else sys.executable}


def _client(name: str) -> str:
    """The command that asks a server; arguments of its program follow."""
    return shlex.join([sys.executable, "-ISE", __file__, name])


def _function(name: str) -> str:
    return f'() {{ {_client(name)} "$@"; }}'


def share_servers() -> None:
    """Start a server of each program for the processes of a test run that this one starts. It imports at its first call."""
    os.environ[SERVERS] = json.dumps({program: _server(program) for program in PRELOADED})


@cache
def _server(program: str) -> str:
    """The name of a socket: the shared server's, or that of a process that forks, which starts here and ends with this one."""
    if SERVERS in os.environ:
        return json.loads(os.environ[SERVERS])[program]
    name = f"egosplat-tests-{secrets.token_hex(8)}"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"\0{name}")
        listener.listen(16)
        environment = os.environ | SET_BY_THE_COMMAND | {THREADS: "1"}
        environment.pop("PYTHONPATH", None)
        handle = listener.fileno()
        words = [sys.executable, __file__, "--serve", program, str(handle)]
        _RUNNING.append(subprocess.Popen(words, stdin=subprocess.PIPE, env=environment, pass_fds=[handle]))
    return name


_RUNNING: list["subprocess.Popen[bytes]"] = []


def _ask(
    name: str, arguments: list[str], folder: str, environment: dict[str, str], streams: list[int]
) -> int:
    """Have the server run its program with streams, in a folder and an environment; its exit status."""
    call = {"arguments": arguments, "folder": folder, "environment": environment}
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(f"\0{name}")
        socket.send_fds(connection, [b"."], streams)
        connection.sendall(json.dumps(call).encode() + b"\n")
        return int(connection.makefile().readline())


def _ask_as_python(name: str, stages: str, arguments: list[str]) -> int:
    """Have the server run what ``python -m snakemake`` is asked for in a cluster's job; its stages are warm.
    The shell of a job drops the variable of ``warm_stages``, because its name is none in a shell."""
    environment = dict(os.environ)
    environment.pop(STAGES, None)
    if stages != COLD:
        environment[STAGES] = _function(stages)
    return _ask(name, arguments[2:], os.getcwd(), environment, [0, 1, 2])


def _next_call(listener: socket.socket, program: str) -> dict[str, Any] | None:
    """Fork for each call: in the child, with the caller's streams, return it; in the server, None when its input ends."""
    while listener in select.select([listener, sys.stdin], [], [])[0]:
        connection, _ = listener.accept()
        _preload(program)
        if os.fork() == 0:
            listener.close()
            return _fork(connection)
        connection.close()
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass  # their processor time now counts as this process's
    return None


@cache
def _preload(program: str) -> None:
    leave_flushing()
    for name in PRELOADED[program]:
        import_module(name)
    if program == "snakemake":
        import_module("snakemake.cli").get_argument_parser()  # imports the plugins
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


def _become(program: str, call: Mapping[str, Any]) -> None:
    """Make this process what the program is at its start."""
    os.chdir(call["folder"])
    os.environ.clear()
    os.environ.update(call["environment"])
    if program == "egosplat" and os.environ.get(THREADS) != "1":
        os.execv(sys.executable, [sys.executable, "-m", "egosplat.cli", *call["arguments"]])
    first = [call["folder"]] if program == "snakemake" else []
    sys.path[0:1] = [*first, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    tempfile.tempdir = None  # found anew, in the call's environment
    sys.dont_write_bytecode = "PYTHONDONTWRITEBYTECODE" in os.environ
    sys.argv[:] = [program, *call["arguments"]]


def _run(program: str) -> None:
    """Run the program and end without taking the libraries down, which takes longer than a small command."""
    status = 0
    try:
        if program == "snakemake":
            signal.alarm(TIMEOUT_S)
            _settle_on_cluster()
            import_module("snakemake.cli").main(sys.argv[1:])
        else:
            import_module("egosplat.cli").main()
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        status = 1 if isinstance(end.code, str) else int(end.code or 0)
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _settle_on_cluster() -> None:
    """Check a cluster's jobs often, and start Python there with the commands of ``on_cluster``."""
    if JOBS not in os.environ:
        return
    remote = import_module("snakemake_interface_executor_plugins.executors.remote").RemoteExecutor
    step = import_module("snakemake_executor_plugin_slurm_jobstep").Executor

    wait = import_module("asyncio").sleep
    remote.sleep = lambda _: wait(STATUS_CHECKS_S)
    for executor, name in ((remote, JOBS), (step, STEPS)):
        executor.get_python_executable = lambda _, python=os.environ[name]: python


if __name__ == "__main__" and sys.argv[1] != "--serve":
    name, *words = sys.argv[1:]
    if words[1:3] == ["-m", "snakemake"]:
        sys.exit(_ask_as_python(name, words[0], words[1:]))
    sys.exit(_ask(name, words, os.getcwd(), dict(os.environ), [0, 1, 2]))
elif __name__ == "__main__":
    program, handle = sys.argv[2:]
    if (call := _next_call(socket.socket(fileno=int(handle)), program)) is None:
        os._exit(0)
    _become(program, call)
    _run(program)
