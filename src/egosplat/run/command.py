"""``egosplat run``: from a recording to a row of the local table of scenes, and by Snakemake to a scene that answers."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from egosplat.calibration.files import AUTO
from egosplat.doctor.inputs import read_configuration
from egosplat.errors import UserError
from egosplat.files import read_user_text, write_text
from egosplat.pipeline.config import LayeredConfig
from egosplat.pipeline.home import SNAKEFILE, find_home
from egosplat.pipeline.scenes import Scene, local_table, read_rows, scene_of_row, tables_of
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.run.sources import name_of, read_source

# The page that a run makes, whose inputs are all that a query needs.
GOAL = "scene_page"

# The dataset of a scene that is named without one.
DATASET = "mine"


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
    if run_snakemake(words):
        raise UserError(f"{scene.name}: a step failed; Snakemake names it and its log above")
    return scene


def _parsed(pairs: Iterable[str]) -> dict[str, str]:
    """Keys and values of the options of a row."""
    for pair in pairs:
        if not pair.partition("=")[2] or any(map(str.isspace, pair)):
            raise UserError(f"--set {pair}: is not of the form section.key=value, as in frames.stride=2")
    return dict(pair.split("=", 1) for pair in pairs)


def _command(scene: Scene, cores: int, settings: Sequence[str]) -> list[str]:
    """The words of Snakemake's command."""
    path = find_home(SNAKEFILE)
    place = [] if path == SNAKEFILE else ["--snakefile", str(path)]
    config = ["--config", *settings] if settings else []
    # Two jobs on one GPU may exceed its memory.
    gpu = ["--resources", "gpu=1"] if shutil.which("nvidia-smi") else []
    goal = scene.results / STAGES[GOAL].output
    return ["snakemake", *place, "--cores", str(cores), *gpu, *config, "--", str(goal)]


def run_snakemake(words: Sequence[str]) -> int:
    """Run Snakemake, and get its exit status. A signal that ends this process ends Snakemake and its steps first."""
    # A group of its own, so that Ctrl-C, a lost terminal or a scheduler's end reaches it once, by ``_stop``.
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
    process = subprocess.Popen([sys.executable, "-m", *words], start_new_session=True)
    try:
        return process.wait()
    except BaseException:
        _stop(process)
        raise


def _stop(process: "subprocess.Popen[bytes]") -> None:
    """End Snakemake and its steps: their unfinished outputs are removed. A second Ctrl-C kills them."""
    try:
        os.killpg(process.pid, signal.SIGINT)
        process.wait()
    except ProcessLookupError:
        process.wait()
    except KeyboardInterrupt:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def split_name(name: str) -> tuple[str, str]:
    """Split ``dataset/scene``; a name without a dataset is one of ``mine`` (UserError: it has another form)."""
    if (found := re.fullmatch(r"(?:(?!benchmark/)([a-z0-9_]+)/)?([A-Za-z0-9_-]+)", name)) is None:
        raise UserError(
            f"--name {name}: is no dataset/scene, as in mine/kitchen_2: dataset of small letters, digits and _, and not "
            "benchmark; scene of letters, digits, _ and -"
        )
    return found[1] or DATASET, found[2]


# The local table of scenes, which git ignores, has one row for each recording that was given.
def put_row(config: LayeredConfig, row: Mapping[str, str]) -> Scene:
    """Write a scene's row into the local table, in place of that of the same recording (UserError)."""
    scene = scene_of_row(dict(row), config, f"{row['dataset']}/{row['scene']}")
    path = local_table(config)
    for table in filter(Path.exists, tables_of(config)):
        _check_name(scene, [other for _, other in read_rows(table)], table, is_local=table == path)
    head = "\t".join(row)
    lines = read_user_text(path).splitlines() if path.exists() else [head]
    own = re.compile(rf"{scene.dataset}\t{scene.scene}\t")
    kept = [line for line in lines if not own.match(line)]
    write_text(path, "\n".join([*kept, "\t".join(row.values())]) + "\n")
    return scene


def _check_name(scene: Scene, rows: list[dict[str, str]], table: Path, *, is_local: bool) -> None:
    """Check that no other recording has the name of a scene. In the local table one that is gone frees it."""
    for row in rows:
        if (row["dataset"], row["scene"]) != (scene.dataset, scene.scene):
            continue
        other = Path(row["recording"])
        if is_local and (other.resolve() == scene.recording.resolve() or not other.exists()):
            continue
        raise UserError(
            f"{scene.name}: is in {table} already, with the recording {other}; give this one another name, as in "
            f"--name {scene.name}2"
        )
