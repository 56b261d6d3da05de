"""The workflow itself: what Snakemake is given, and names that a shell would make commands of."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bad_input_bench.attempts import sandbox
from bad_input_bench.cases import Sandbox
from bad_input_bench.pictures import folder_of_pictures
from bad_input_bench.report import Tried
from bad_input_bench.scene import run_snakemake
from bad_input_bench.table_of_scenes import HEADER
from bad_input_bench.verdicts import ACCEPTED, CLEAR, HARM, MOST_LINES, TRACEBACK, UNCLEAR
from egosplat.progress import log, track

FAMILY = "workflow"
SMUGGLED = "touch ../outside/canary"

ODD_NAMES = (
    "two words",
    f"a;{SMUGGLED}",
    f"$({SMUGGLED})".replace("/", "\u2215"),
    "`touch canary`",
    "it's",
    'say "hi"',
    "[1-3]*",
    "-rf",
    "K\u00fcche \u65e5\u672c",
    "# no comment",
    "&& touch canary",
    "| tee canary",
    "%s$HOME",
)
"""Names of folders of photographs, each of which is a good recording."""


@dataclass(frozen=True)
class Parsed:
    """A dry run: words of the command line, what is changed before, and what the message names."""

    name: str
    words: tuple[str, ...]
    named: str
    file: str = ""
    content: str = ""


CONFIG, SCENES = "config/config.yaml", "config/scenes.tsv"
GOOD = HEADER + "mine\tscene90\tplain\t{}\t{}\n"

DRY = (
    Parsed("--config preset", ("--config", f"preset=$({SMUGGLED})"), "preset"),
    Parsed("--config NaN", ("--config", "frames={start_s: .nan}"), "start_s"),
    Parsed("config.yaml no YAML", (), CONFIG, CONFIG, "frames: ["),
    Parsed("config.yaml a command", (), CONFIG, CONFIG, f"a: !!python/object/apply:os.system ['{SMUGGLED}']"),
    Parsed(
        "scenes.tsv a name with a command", (), SCENES, SCENES, HEADER + f"mine\t$({SMUGGLED})\tplain\tx\t\n"
    ),
    Parsed("scenes.tsv options no YAML", (), SCENES, SCENES, GOOD.format("x", "frames.stride=[")),
    Parsed("a recording that is absent", (), "x;y", SCENES, GOOD.format("x;y", "")),
    Parsed("a scene that is not in the table", (), "scene90"),
    Parsed("a variant that there is not", (), "nothing"),
)


def tries(finished: Path, root: Path) -> list[Tried]:
    """All of this family; each dry run takes seconds."""
    results = [_parsed(one, finished, root) for one in track(DRY, "dry runs", unit="run")]
    return [*results, *_odd_names(finished, root)]


def _parsed(one: Parsed, finished: Path, root: Path) -> Tried:
    box = sandbox(finished, root, scene=False)
    if one.file:
        (box.folder / one.file).write_text(one.content)
    target = "results/mine/scene90/frames.zarr"
    if "variant" in one.name:
        target = "results/adt/scene1/variants/nothing/splats.zarr"
    done = run_snakemake(box.folder, "--dry-run", "--quiet", "all", *one.words, "--", target)
    text = "\n".join(
        line
        for line in (done.stdout + done.stderr).splitlines()
        if not line.startswith(("Using ", "Config file "))
    )
    return _told(one.name, _verdict(box, done.returncode, text, one.named), text)


def _verdict(box: Sandbox, status: int, text: str, named: str) -> str:
    if box.canary.exists() or (box.folder / "canary").exists() or not (box.outside / "sentinel.txt").exists():
        return HARM
    if "Traceback" in text:
        return TRACEBACK
    if status == 0:
        return HARM
    return CLEAR if named in text and len(text.strip().splitlines()) <= MOST_LINES else UNCLEAR


def _told(name: str, verdict: str, text: str) -> Tried:
    if verdict not in (CLEAR, ACCEPTED):
        log(f"{verdict}: {FAMILY}: {name}\n{text[-1500:]}\n")
    return Tried(
        FAMILY, name, verdict, text, "the name is odd, and the recording good: it is read like any other"
    )


def _odd_names(finished: Path, root: Path) -> Iterator[Tried]:
    """One run over recordings with odd names: each is read, and nothing of its name is run."""
    box = sandbox(finished, root, scene=False)
    shutil.rmtree(box.folder / "results", ignore_errors=True)
    rows, targets = [], []
    for number, name in enumerate(ODD_NAMES):
        folder_of_pictures(box.folder / "photos" / name.replace("/", "_"))
        options = "frames.resolution=64 frames.evaluation_frames=1"
        row = f"mine\ts{number}\tplain\tphotos/{name.replace('/', '_')}\t{options}"
        rows.append("\t".join(f'"{cell.replace(chr(34), chr(34) * 2)}"' for cell in row.split("\t")))
        targets.append(f"results/mine/s{number}/frames.zarr")
    (box.folder / "config/scenes.tsv").write_text(HEADER + "\n".join(rows) + "\n")
    done = run_snakemake(box.folder, "--keep-going", "--quiet", "all", "--", *targets)
    smuggled = box.canary.exists() or any(box.folder.rglob("canary")) or any(box.outside.glob("canary*"))
    for name, target in zip(ODD_NAMES, targets, strict=True):
        made = (box.folder / target / "zarr.json").exists()
        yield _told(
            f"a recording called {name!r}",
            HARM if smuggled else ACCEPTED if made else UNCLEAR,
            done.stdout + done.stderr,
        )
