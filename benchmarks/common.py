"""Code that several benchmarks share: command lines, tables, time and processes."""

import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from egosplat.artifacts.lineage import locate
from egosplat.errors import UserError
from egosplat.progress import show_log

# The repository.
ROOT = Path(__file__).resolve().parents[1]

MIB = 2**20

T = TypeVar("T")


class _Command(click.Command):
    """A command that shows progress, and reports a ``UserError`` in one line, without a traceback."""

    def invoke(self, context: click.Context) -> Any:
        show_log()
        try:
            return super().invoke(context)
        except UserError as error:
            raise click.ClickException(str(error)) from error


def command(about: str | None) -> Callable[[Callable[..., None]], click.Command]:
    """Decorator that makes a function a benchmark's command line; ``about`` is its help text."""
    return click.command(cls=_Command, help=about)


# Decorator: one or more folders of scenes, as ``folders``.
scene_folders = click.argument(
    "folders", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path)
)


def survey_of(folder: Path) -> Path | None:
    """The survey of a scene or variant, its own or the scene's; None if it was made without one."""
    (frames,) = locate(folder, "frames")
    paths = (folder / "survey.json", frames.with_name("survey.json"))
    return next((path for path in paths if path.exists()), None)


def markdown(columns: Sequence[str], rows: Iterable[Sequence[object]], words: int = 1) -> str:
    """A Markdown table. The first ``words`` columns are aligned to the left, the others to the right."""
    marks = ["---"] * words + ["---:"] * (len(columns) - words)
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in [columns, marks, *rows])


def time_call(call: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """The result of a call, and its processor time over all threads [s]."""
    start = time.process_time()
    return call(*arguments), time.process_time() - start


def cpu_seconds_of(words: Sequence[str], folder: Path, **environment: str) -> float:
    """Processor time of a command and of the processes that it waits for [s]; as ``usage_of``."""
    return usage_of(words, folder, **environment)[0]


def usage_of(words: Sequence[str], folder: Path, **environment: str) -> tuple[float, float]:
    """Processor time of a command and of the processes that it waits for [s], and the peak memory of the largest [MiB].

    Raises:
        UserError: it failed; the message holds the end of its output.
    """
    with tempfile.TemporaryFile("w+", errors="replace") as output:
        process = subprocess.Popen(
            words, cwd=folder, env=os.environ | environment, stdout=output, stderr=subprocess.STDOUT
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            output.seek(0)
            raise UserError(f"{shlex.join(words)} failed in {folder}:\n{output.read()[-1000:]}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def output_of(module: str, *arguments: object, **environment: str) -> str:
    """Standard output of ``python -m MODULE ARGUMENTS``, run in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", module, *map(str, arguments)],
        check=True,
        cwd=ROOT,
        env=os.environ | environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    return done.stdout
