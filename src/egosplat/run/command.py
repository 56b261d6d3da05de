"""``egosplat run``: from a recording to a scene that answers, by Snakemake, with a line for each step."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from egosplat.calibration.companions import AUTO
from egosplat.doctor.inputs import read_configuration
from egosplat.errors import UserError
from egosplat.pipeline.home import SNAKEFILE, snakefile
from egosplat.pipeline.scenes import Scene
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.run.sources import name_of, read_source
from egosplat.run.steps import GOAL, Forecast, Steps, machine_pace
from egosplat.run.table import put_row, split_name


def make_scene(
    source: Path,
    name: str | None = None,
    preset: str | None = None,
    options: Sequence[str] = (),
    cores: int | None = None,
) -> Scene:
    """Write the row of a recording, and run the workflow to the scene's page.

    Args:
        source: file or folder.
        name: of the scene, with or without its dataset; None: from the source.
        preset: None: that of the configuration.
        options: keys of the scene's row, as ``frames.stride=3``.
        cores: number of processors; None: all.

    Raises:
        UserError: the source is no recording, the name is taken, a key is wrong, or a step failed.
        KeyboardInterrupt: after Snakemake has ended.
    """
    settings = [f"preset={preset}"] if preset else []
    config, _ = read_configuration([], settings)
    dataset, scene_name = split_name(name or name_of(source))
    given = _parsed(options)
    place = Path("results") / dataset / scene_name / "recording"
    found = read_source(source, place, given.get("frames.known_poses", AUTO))
    keys = " ".join(f"{key}={value}" for key, value in {**found.options, **given}.items())
    row = {"dataset": dataset, "scene": scene_name, "format": found.format, "recording": str(found.path)}
    scene = put_row(config, row | {"options": keys})
    stride = scene.config["frames"]["stride"]
    taken = f", every {stride}th taken (frames.stride={stride})" if stride > 1 else ""
    log(f"{scene.name}: {found.about}{taken}, {found.path}; preset {config['preset']}")
    cores = cores or len(os.sched_getaffinity(0))
    words = _command(scene, cores, settings)
    log(f"Snakemake's command, to go on with: {shlex.join(words)}")
    steps = Steps(Forecast(scene, found.count, found.known), machine_pace(cores))
    if run_snakemake(words, steps):
        raise UserError(steps.explain())
    return scene


def _parsed(pairs: Iterable[str]) -> dict[str, str]:
    """Keys and values of the options of a row."""
    for pair in pairs:
        if not pair.partition("=")[2] or any(map(str.isspace, pair)):
            raise UserError(f"--set {pair}: is not of the form section.key=value, as in frames.stride=2")
    return dict(pair.split("=", 1) for pair in pairs)


def _command(scene: Scene, cores: int, settings: Sequence[str]) -> list[str]:
    """The words of Snakemake's command."""
    path = snakefile()
    place = [] if path == SNAKEFILE else ["--snakefile", str(path)]
    config = ["--config", *settings] if settings else []
    goal = scene.results / STAGES[GOAL].output
    return ["snakemake", *place, "--cores", str(cores), *config, "--", str(goal)]


def run_snakemake(words: Sequence[str], steps: Steps) -> int:
    """Run Snakemake, and show a line for each step; get its exit status."""
    # A group of its own, so that Ctrl-C, a lost terminal or a scheduler's end reaches it once, by ``_stop``.
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
    process = subprocess.Popen(
        [sys.executable, "-m", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    screen = Screen()
    try:
        assert process.stdout is not None
        for line in process.stdout:
            screen.show(steps.read(line.rstrip("\n")), steps.work)
        return process.wait()
    except BaseException:
        _stop(process)
        raise
    finally:
        screen.show([], "")


def _stop(process: "subprocess.Popen[str]") -> None:
    """End Snakemake and its steps: their unfinished outputs are removed. A second Ctrl-C kills them."""
    try:
        os.killpg(process.pid, signal.SIGINT)
        process.communicate()
    except ProcessLookupError:
        process.wait()
    except KeyboardInterrupt:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


class Screen:
    """Lines that stay, and on a terminal below them one that is written over: the last line of a running step."""

    def __init__(self) -> None:
        self._is_terminal, self._hint = sys.stderr.isatty(), ""

    def show(self, lines: Sequence[str], hint: str) -> None:
        """Show lines, then a hint in place of the last one."""
        redrawn = self._is_terminal and (bool(lines) or hint != self._hint)
        if redrawn:
            sys.stderr.write("\r\x1b[K")
        for line in lines:
            log(line)
        if redrawn:
            sys.stderr.write(hint[: shutil.get_terminal_size().columns - 1])
            sys.stderr.flush()
        self._hint = hint
