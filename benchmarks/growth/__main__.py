"""Growth of the processor time and peak memory of every stage with frames, instances and phrases.

    python -m benchmarks.growth FOLDER > tables.md

FOLDER takes the scenes: one walk through a small apartment (config.yaml), filmed with 5, 50 and 500 frames. The Gaussians of the
second are divided into 10, 100 and 1,000 cells, whose masks the stages that read instances get; `segments` gets as many times the
prompts. Each command runs in a process of its own on one thread, without Snakemake; what is done is not done again.

A growth of 1 is linear. It is the exponent of what is more than at the smallest size: the start of Python and of models does not count.
"""

import json
import math
from collections.abc import Iterable
from pathlib import Path

import click

from benchmarks.common import ROOT, command, markdown, output_of, usage_of
from benchmarks.stage_times.__main__ import Checkout
from egosplat.pipeline.config import Config, merge, read_yaml, resolve
from egosplat.pipeline.dag import inputs_of, options_json
from egosplat.pipeline.stages import PAGES, STAGES
from egosplat.progress import log

FRAMES, THINGS = (5, 50, 500), (10, 100, 1000)

# Side of the grid of prompts.
PROMPTS = (4, 13, 40)

# Of methods of others: a frame takes a CPU-second.
LEFT_OUT = ("tiles",)

# Stages that should take the same time for any number of frames.
FIXED = ("annotations", "poses", "transient", "splats", "metrics", *PAGES)

# Stages that read instances, or what is made of them; pages draw few of them.
OF_THINGS = ("instances", "view_features", "features", "masks", "splats", "language", "metrics")

# What the table of scenes tells a stage.
OF_SCENE = {"frames": ("--format", "adt"), "metrics": ("--title", "growth/apartment")}

# Noise of an increase [CPU-s, MiB]; a growth above the law by no more than the margin is none.
NOISE, MARGIN = (1.0, 50.0), 0.2

Used = tuple[float, float]


def configuration(**more: object) -> Config:
    """The configuration of the apartment, with other values of some keys."""
    return resolve(merge(read_yaml(Path(__file__).with_name("config.yaml")), more), ROOT / "config/presets")


def use(target: Path, *words: object) -> Used:
    """Processor time [s] and peak memory [MiB] of a command that writes a target; as recorded if that is done."""
    record = target.with_name(f"{target.name}.used")
    if not record.exists():
        checkout = Checkout(ROOT)
        used = usage_of(checkout.words(*words, "--output", target), ROOT, **checkout.environment)
        log(f"{target}: {used[0]:.1f} CPU-s, {used[1]:.0f} MiB")
        record.write_text(json.dumps(used))
    seconds, mib = json.loads(record.read_text())
    return seconds, mib


def run(stage: str, folder: Path, config: Config, output: str = "") -> Used:
    """What a stage uses in the folder of its scene."""
    paths = {name: folder / STAGES[name].output for name in inputs_of(stage, config)}
    paths |= {"recording": folder / "recording"} if "recording" in STAGES[stage].inputs else {}
    words = [word for name, path in paths.items() for word in (f"--{name.replace('_', '-')}", path)]
    words += ["--options", options_json(stage, config)] if STAGES[stage].options else []
    target = folder / (output or STAGES[stage].output)
    return use(target, stage.replace("_", "-"), *words, *OF_SCENE.get(stage, ()))


def growth(values: Iterable[float], noise: float) -> float | None:
    """Exponent of the increase between three sizes, the smaller at least the noise; None if the larger is below twice that."""
    small, middle, large = values
    if large - middle < 2 * noise:
        return None
    return math.log10((large - middle) / max(middle - small, noise))


def row(name: str, used: Iterable[Used], law: int = 1) -> list[str]:
    """A row: time and memory at each size with their growth, the law, and whether a growth is worse."""
    cells, worse = [f"`{name}`"], False
    for values, noise, digits in zip(zip(*used, strict=True), NOISE, (1, 0), strict=True):
        grown = growth(values, noise)
        worse |= grown is not None and grown > law + MARGIN
        cells += [*(f"{value:.{digits}f}" for value in values), "-" if grown is None else f"{grown:.1f}"]
    return [*cells, f"{law}, **worse**" if worse else f"{law}"]


def frame_rows(folder: Path) -> list[list[str]]:
    """Rows of all stages against frames."""
    scenes = {folder / f"{count}": configuration(synthetic={"fps": count / 24}) for count in FRAMES}
    for scene in scenes:
        scene.mkdir(parents=True, exist_ok=True)
    used = {name: [run(name, *one) for one in scenes.items()] for name in STAGES if name not in LEFT_OUT}
    return [row(name, found, int(name not in FIXED)) for name, found in used.items()]


def thing_rows(folder: Path) -> list[list[str]]:
    """Rows against instances: the stages that read them."""
    scene, cells = folder / f"{FRAMES[1]}", [folder / f"things{count}" for count in THINGS]
    keys = {f"segments{side}.zarr": configuration(segments={"points_per_side": side}) for side in PROMPTS}
    prompted = [run("segments", scene, config, name) for name, config in keys.items()]
    for made, count in zip(cells, THINGS, strict=True):
        if not (made / STAGES["segments"].output).exists():
            output_of("benchmarks.growth.masks", scene, made, count)
    used = {name: [run(name, made, configuration()) for made in cells] for name in OF_THINGS}
    return [row("segments", prompted), *(row(name, found) for name, found in used.items())]


def phrase_rows(folder: Path) -> list[list[str]]:
    """Rows against phrases: the commands that read them."""
    scene, asked = folder / f"{FRAMES[1]}", {count: [f"thing {n}" for n in range(count)] for count in THINGS}
    keys = {f"metrics{count}.json": {"negatives": words} for count, words in asked.items()}
    scored = [run("metrics", scene, configuration(presence=one), name) for name, one in keys.items()]
    found = [use(scene / f"{count}.png", "query", scene, *words) for count, words in asked.items()]
    return [row("metrics", scored), row("query", found)]


@command(__doc__)
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Print the tables."""
    tables = {"frames": frame_rows, "instances": thing_rows, "phrases": phrase_rows}
    for what, rows in tables.items():
        first, *rest = (f"{size:,}" for size in (FRAMES if what == "frames" else THINGS))
        columns = [cell for unit in ("CPU-s", "MiB") for cell in (f"{unit} at {first}", *rest, "growth")]
        click.echo(
            f"## {what.capitalize()}\n\n{markdown(['stage', *columns, 'law'], rows(folder.resolve()))}\n"
        )


if __name__ == "__main__":
    main()
