"""Trying a bad input: in a process of its own, so that whatever it does is seen and ends there."""

import contextlib
import gc
import hashlib
import json
import os
import resource
import shutil
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bad_input_bench.cases import Case, Sandbox

LONGEST_S = 180
MEMORY = 12 * 2**30
"""Address space of a try; a file that claims to be huge fails here and not by taking the machine's memory."""


@dataclass(frozen=True)
class Said:
    """What a try did.

    Attributes:
        status: exit status; None where it was killed.
        text: all that it printed.
        made: paths that are new, changed or gone, relative to the sandbox's parent; sorted.
        digest: of the artifact that it made, or None.
    """

    status: int | None
    text: str
    made: tuple[str, ...]
    digest: str | None


def sandbox(finished: Path, root: Path, scene: bool) -> Sandbox:
    """A fresh private copy, in ``root``; without the scene, of the configuration alone."""
    shutil.rmtree(root, ignore_errors=True)
    box = Sandbox(root / "work", root / "outside")
    ignored = None if scene else shutil.ignore_patterns("results")
    shutil.copytree(finished, box.folder, symlinks=True, ignore=ignored)
    box.outside.mkdir()
    (box.outside / "sentinel.txt").write_text("not yours")
    (box.outside / "folder").mkdir()
    (box.outside / "folder/photo.png").write_bytes(b"not yours either")
    return box


def attempt(case: Case, finished: Path, root: Path, undisturbed: bool = False) -> Said:
    """Break, call, and see what became of it.

    Args:
        case: what is tried.
        finished: the scene that copies are made of.
        root: folder for the copy; lost.
        undisturbed: call the case's undisturbed command instead.
    """
    box = sandbox(finished, root, case.scene)
    report = root / "report.json"
    gc.freeze()  # else a collection in the child copies all that was imported
    process = os.fork()
    if process == 0:
        _child(case.undisturbed if undisturbed else case.command, box, report)
    _, status = os.waitpid(process, 0)
    text = (root / "said.txt").read_text(errors="replace") if (root / "said.txt").exists() else ""
    if not report.exists():
        raise RuntimeError(f"{case.family}: {case.name}: could not be broken\n{text}")
    before = json.loads(report.read_text())
    after = _seen(root)
    made = tuple(sorted(name for name in {*before, *after} if before.get(name) != after.get(name)))
    ended = os.waitstatus_to_exitcode(status)
    return Said(ended if ended >= 0 else None, text, made, _digest(box.made))


def _child(command: Callable[[Sandbox], object], box: Sandbox, report: Path) -> None:
    """Never returns."""
    code = 1
    try:
        os.chdir(box.folder)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        signal.alarm(LONGEST_S)
        _cut_off(box)
        said = report.with_name("said.txt")
        with said.open("a") as stream:
            os.dup2(stream.fileno(), 1)
            os.dup2(stream.fileno(), 2)
        sys.stdout, sys.stderr = (open(number, "w", buffering=1, closefd=False) for number in (1, 2))  # noqa: SIM115 - for good
        words = command(box)
        report.write_text(json.dumps(_seen(report.parent)))
        os.truncate(said, 0)
        code = _call(words)
    except BaseException:  # noqa: BLE001 - whatever it is, it is what is looked for
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _cut_off(box: Sandbox) -> None:
    """No other machine is to be reached; a try to is harm."""

    def refuse(*_: object, **__: object) -> None:
        box.canary.write_text("a connection was tried")
        raise OSError("no network")

    socket.socket.connect = refuse
    socket.getaddrinfo = refuse


def _call(words: object) -> int:
    from egosplat import cli
    from egosplat.errors import UserError

    try:
        if callable(words):
            words()
        else:
            sys.argv = ["egosplat", *map(str, words)]
            cli.main()
    except UserError as error:  # as the workflow ends with it
        print(f"egosplat: {error}", file=sys.stderr)
        return 2
    except SystemExit as stop:
        if isinstance(stop.code, str):
            print(stop.code, file=sys.stderr)
            return 1
        return int(stop.code or 0)
    return 0


def _seen(root: Path) -> dict[str, list[object]]:
    """Every file, folder and link below the working directory and beside it, so that any change is seen."""
    seen: dict[str, list[object]] = {}
    for top in (root / "work", root / "outside"):
        for folder, names, files in os.walk(top):
            for name in (*names, *files):
                path = os.path.join(folder, name)
                facts = os.lstat(path)
                is_folder = os.path.isdir(path) and not os.path.islink(path)
                told = [facts.st_ino] if is_folder else [facts.st_ino, facts.st_size, facts.st_mtime_ns]
                seen[os.path.relpath(path, root)] = told
    return seen


def _digest(path: Path) -> str | None:
    """Of what a command made, apart from how and when; None where that cannot be told."""
    if path.is_file():
        content = path.read_bytes()
        with contextlib.suppress(ValueError):
            told = {key: value for key, value in json.loads(content).items() if key != "provenance"}
            content = json.dumps(told, sort_keys=True).encode()
        return hashlib.sha256(content).hexdigest()
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        attributes = json.loads((path / "zarr.json").read_text())["attributes"]["egosplat"]
        return hashlib.sha256(attributes["digest"].encode()).hexdigest()
    return None
