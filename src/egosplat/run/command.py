"""``egosplat run``: from a recording to a row of the local table of scenes, and by Snakemake to a scene that answers."""

import contextlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from egosplat.calibration.files import source_files
from egosplat.doctor.inputs import read_configuration
from egosplat.errors import UserError
from egosplat.files import alone, read_user_text, write_text
from egosplat.models.needed import download, find_needed, why_unreachable
from egosplat.pipeline.config import Layer, LayeredConfig, configure, parse_options
from egosplat.pipeline.home import SNAKEFILE, find_home
from egosplat.pipeline.model_sets import LIGHT, PHOTOS
from egosplat.pipeline.process_guards import STARTED_BY
from egosplat.pipeline.scenes import Scene, given_recording, local_table, read_rows, scene_of_row, tables_of
from egosplat.pipeline.stages import STAGES
from egosplat.progress import is_hushed, log
from egosplat.run.sources import name_of, read_source


def make_scene(
    source: Path,
    name: str | None = None,
    preset: str | None = None,
    options: Sequence[str] = (),
    cores: int | None = None,
    during: Callable[[Path], contextlib.AbstractContextManager[object]] = contextlib.nullcontext,
) -> Scene:
    """Write the row of a recording, a file or folder, with the keys ``options``, and run the workflow to the scene's page.

    None is for the name of the source, the preset of the configuration, and all processors. The steps run inside the context
    ``during`` of the scene's folder. UserError: the source is no recording, the name is taken, a key is wrong, weights are
    missing, a step failed, or another process makes the scene.
    """
    settings = [f"preset={preset}"] if preset else []
    config, _ = read_configuration([], settings)
    dataset, scene_name = split_name(name or name_of(source))
    for pair in options:
        if not pair.partition("=")[2] or any(map(str.isspace, pair)):
            raise UserError(
                f"--set {pair}: is not of the form section.key=value without blanks, as in frames.stride=2"
            )
    given = dict(pair.split("=", 1) for pair in options)
    unpacked = Path("results") / dataset / scene_name / "recording"
    asked = Layer("--set", parse_options(" ".join(options), "--set"))
    found = read_source(source, unpacked, configure([*config.layers, asked])["frames"]["known_poses"])
    keys = {**found.options, **given}
    row = {"dataset": dataset, "scene": scene_name, "format": found.format, "recording": str(found.path)}
    row["options"] = " ".join(f"{key}={value}" for key, value in keys.items())
    # Before the row changes.
    with alone(unpacked.parent, f"{dataset}/{scene_name}"):
        keys |= choose_set(config, row, "models.set" in keys)
        row["options"] = " ".join(f"{key}={value}" for key, value in keys.items())
        scene = put_row(config, row)
        # Their step would tell what is missing only after those before it.
        download([file for file in find_needed([scene.config]) if file.missing])
        if splat := scene.config["splats"]["source"]:
            source_files(splat)
        stride = scene.config["frames"]["stride"]
        taken = f", one in {stride} taken (frames.stride={stride})" if stride > 1 else ""
        about = f"{scene.name}: {found.about}{taken}, {found.path}; preset {config['preset']}"
        log(f"{about}, models {scene.config['models']['set']}")
        words = ["snakemake", "--cores", str(cores or len(os.sched_getaffinity(0)))]
        if (workflow := find_home(SNAKEFILE)) != SNAKEFILE:
            words[1:1] = ["--snakefile", str(workflow)]
        # Two jobs on one GPU may exceed its memory.
        words += ["--resources", "gpu=1"] if shutil.which("nvidia-smi") else []
        words += ["--config", *settings] if settings else []
        # The inputs of the page are all that a query needs; Snakemake makes anew only what is named.
        stages = ("scene_page", *STAGES["scene_page"].inputs)
        words += ["--", *(str(scene.results / STAGES[name].output) for name in stages)]
        log(f"Snakemake plans the steps, which takes seconds; to continue yourself: {shlex.join(words)}")
        with during(scene.results):
            if run_snakemake(words):
                raise UserError(f"{scene.name}: a step failed; Snakemake names it and its log above")
    return scene


def run_snakemake(words: Sequence[str]) -> int:
    """Run Snakemake, and get its exit status; hushed, it tells alarms alone, and all if it fails. A signal that ends this process
    ends Snakemake and its steps first, which remove their unfinished outputs; a second Ctrl-C, or ten seconds, kill them."""
    # A group of its own, so that Ctrl-C, a lost terminal or a scheduler's end reaches it once, by this process; not nohup's.
    usual, early = signal.getsignal(signal.SIGINT), list[int]()
    endings = [one for one in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(one) != signal.SIG_IGN]
    # A handler becomes the default: what a script starts in the background ignores interrupts, and so would each step.
    for ending in (signal.SIGINT, *endings):
        signal.signal(ending, lambda number, _: early.append(number))
    kept = tempfile.TemporaryFile("w+", errors="replace") if is_hushed() else None  # noqa: SIM115
    command, own = [sys.executable, "-m", *words], os.environ | {STARTED_BY: str(os.getpid())}
    process = subprocess.Popen(command, start_new_session=True, env=own, stdout=kept, stderr=kept)
    signal.signal(signal.SIGINT, usual)
    try:
        for ending in endings:
            signal.signal(ending, signal.default_int_handler)
        if early:
            raise KeyboardInterrupt
        status = process.wait()
        if kept:
            kept.seek(0)
            told = (line for line in kept if status or re.search(": (alarm|warning): ", line))
            print("".join(told), end="", file=sys.stderr)
        return status
    except BaseException:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(10.0)  # compiled code does not hear of a signal
        except (KeyboardInterrupt, subprocess.TimeoutExpired):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        raise


def split_name(name: str) -> tuple[str, str]:
    """Split ``dataset/scene``; a name without a dataset is one of ``mine`` (UserError: it has another form)."""
    if (found := re.fullmatch(r"(?:(?!benchmark/|variants/)([a-z0-9_]+)/)?([A-Za-z0-9_-]+)", name)) is None:
        letters = "dataset of a-z, 0-9 and _, not benchmark or variants; scene of letters, digits, _ and -"
        raise UserError(f"--name {name}: is no dataset/scene, as in mine/kitchen_2: {letters}")
    return found[1] or "mine", found[2]


def choose_set(config: LayeredConfig, row: dict[str, str], anew: bool) -> dict[str, str]:
    """Get ``models.set`` for the row of a real recording whose models nothing chooses; else nothing.

    It is that of the earlier row, so that the network changes no scene; of a new one, or ``anew``, the published models, or the
    bundled ones if the hub does not answer.
    """
    usual, light = (scene_of_row(row, config, row["scene"], real) for real in (PHOTOS, LIGHT))
    if usual.config["models"] == light.config["models"]:
        return {}
    if not anew and (earlier := _row_of(config, light)):
        models = parse_options(earlier[1]["options"], str(earlier[0])).get("models", {})
        return {"models.set": models.get("set", PHOTOS)}  # rows without one are of older versions
    why = why_unreachable(find_needed([light.config]))
    bundled = f"bundled models, which know less. With a network: --set models.set=light ({why})"
    log(bundled if why else "small published models; --set models.set=photos is faster without a GPU")
    return {"models.set": PHOTOS if why else LIGHT}


def _row_of(config: LayeredConfig, scene: Scene) -> tuple[Path, dict[str, str]] | None:
    """The row that the tables have for a scene, behind its table; None if they have none."""
    tables, key = filter(Path.exists, tables_of(config)), (scene.dataset, scene.scene)
    rows = ((table, row) for table in tables for _, row in read_rows(table))
    return next((one for one in rows if (one[1]["dataset"], one[1]["scene"]) == key), None)


def put_row(config: LayeredConfig, row: Mapping[str, str]) -> Scene:
    """Write a scene's row into the local table, in place of that of the same recording (UserError: a key is wrong, or another
    recording has the name, which in the local table one that is gone frees)."""
    scene = scene_of_row(dict(row), config, f"{row['dataset']}/{row['scene']}")
    path, own = local_table(config), f"{scene.dataset}\t{scene.scene}\t"
    with alone(path.parent, str(path), wait=True):
        if earlier := _row_of(config, scene):
            table, other = earlier
            recording = given_recording(other, config)
            freed = recording.resolve() == scene.recording.resolve() or not recording.exists()
            if not (freed and table == path) or other["recording"] == "-":
                told = f"{scene.name}: is in {table} already, with the recording {other['recording']}"
                raise UserError(f"{told}; give this one another name, as in --name {scene.name}2")
        lines = read_user_text(path).rstrip("\n").split("\n") if path.exists() else ["\t".join(row)]
        kept = [line for line in lines if not line.startswith(own)]
        write_text(path, "\n".join([*kept, "\t".join(row.values())]) + "\n")
    return scene
