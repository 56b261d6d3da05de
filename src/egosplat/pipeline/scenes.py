"""The table of scenes: recording and configuration of each scene."""

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from egosplat.calibration.files import recording_origin
from egosplat.errors import UserError
from egosplat.files import expand_home, read_user_text
from egosplat.pipeline.config import Config, Layer, LayeredConfig, of_format, parse_options
from egosplat.pipeline.general_options import Format, GeneralOptions
from egosplat.pipeline.home import find_home
from egosplat.pipeline.messages import make_options
from egosplat.pipeline.model_sets import PHOTOS, SMALL, locate_checkpoints
from egosplat.pipeline.options import Options, Text, check_with

# Datasets with rows in the shipped table, whether their recordings exist or not.
SHIPPED_DATASETS = ("adt", "hoi4d", "lerf", "3d_ovs")

# The advice for a recording that lies elsewhere.
OTHER_PLACE = "change its row in the table of scenes, or data_root, below which relative paths lie"


def _is_path(text: str) -> bool:
    """Whether a text can be a path that Snakemake handles; the longest name on Linux has 255 bytes."""
    plain = re.fullmatch(r"(?!\s)(?![A-Za-z][\w+.-]*://)[^\x00-\x1f\x7f{}]*(?<!\s)", text)
    return bool(plain) and all(len(os.fsencode(part)) <= 255 for part in Path(text).parts)


_LETTERS = "only small letters, digits and _, and not benchmark or variants, folders of other results"
_DATASET = check_with(re.compile("(?!(?:benchmark|variants)$)[a-z0-9_]+").fullmatch, _LETTERS)
_NAME = check_with(re.compile("[A-Za-z0-9_-]+").fullmatch, "only letters, digits, _ and -")
_PATH = check_with(_is_path, "a path, no URL; no braces, control characters, outer blanks, 255 bytes a name")


class Row(Options):
    """A row of the table of scenes, as docs/recordings.md describes it."""

    dataset: Annotated[str, Field(max_length=100), _DATASET]
    scene: Annotated[str, Field(max_length=100), _NAME]
    format: Format
    recording: Annotated[Text, _PATH]
    options: str


@dataclass(frozen=True)
class Scene:
    """A row of the table of scenes, with its paths."""

    dataset: str  # first folder below results
    scene: str  # second folder below results
    format: str  # of its recording
    recording: Path  # folder or file; inside results if it is synthetic
    synthetic: bool  # whether egosplat makes the recording
    config: LayeredConfig  # complete, including the row's own keys
    by_name: bool = False  # whether only a target that names the scene makes it
    rendered: bool = False  # whether egosplat made the recording, or makes it

    @property
    def name(self) -> str:
        """Name in messages and titles, ``adt/scene1``."""
        return f"{self.dataset}/{self.scene}"

    @property
    def results(self) -> Path:
        return Path("results", self.dataset, self.scene)

    @property
    def lacks_recording(self) -> bool:
        """Whether its recording can not be made, and is not there."""
        return not (self.synthetic or self.recording.exists())


def read_scenes(config: LayeredConfig) -> dict[tuple[str, str], Scene]:
    """Read the table that the configuration names, and the local one beside it (UserError: one or a row is wrong)."""
    tables = tables_of(config)
    rows = {f"{path}, line {number}": row for path in tables for number, row in read_rows(path)}
    datasets = {*SHIPPED_DATASETS, *(row["dataset"] for row in rows.values())}
    if unknown := sorted(set(config["data_root"]) - datasets):
        has = f"{tables[0]} has no such dataset; it has {', '.join(sorted(datasets))}"
        raise UserError(f"configuration: data_root.{unknown[0]}: {has}")
    scenes: dict[tuple[str, str], Scene] = {}
    for where, row in rows.items():
        scene = scene_of_row(row, config, where)
        key = (scene.dataset, scene.scene)
        if key in scenes:
            raise UserError(f"{where}: scene {scene.name} is in the table twice; remove or rename one")
        scenes[key] = scene
    return scenes


def tables_of(config: Config) -> list[Path]:
    """Get the tables of scenes that are there; the one that the configuration names if there is none."""
    named = expand_home(config["scenes"])
    named = find_home(named) if named == Path(GeneralOptions().scenes) else named
    return [path for path in (named, local_table(config)) if path.exists()] or [named]


def local_table(config: Config) -> Path:
    """Get the path of the local table, which need not exist: ``scenes.local.tsv`` beside ``scenes.tsv``."""
    named = expand_home(config["scenes"])
    return named.with_name(f"{named.stem}.local{named.suffix}")


def find_scene(scenes: Mapping[tuple[str, str], Scene], dataset: str, scene: str) -> Scene:
    """Get a scene by name (UserError: the table has no such scene; lists its scenes)."""
    if (dataset, scene) not in scenes:
        known = ", ".join("/".join(key) for key in scenes) or "none"
        advice = f"Add a row, or take one of: {known}"
        raise UserError(f"no scene {dataset}/{scene} in the table of scenes. {advice}")
    return scenes[dataset, scene]


def default_scenes(scenes: Iterable[Scene]) -> list[Scene]:
    """Get the scenes of a run without a target: those with a recording, and synthetic ones that need not be named."""
    return [scene for scene in scenes if not (scene.by_name or scene.lacks_recording)]


def check_recording(scene: Scene) -> None:
    """Check that a recording exists or can be made (UserError: it is missing; names the expected path)."""
    if scene.lacks_recording:
        raise UserError(f"{scene.name}: no recording at {scene.recording}. Put it there, or {OTHER_PLACE}")


def is_own(scene: Scene) -> bool:
    """Whether the user wants a row: rows of the shipped table count only if their root is set."""
    rooted = scene.config["data_root"].get(scene.dataset) is not None
    return rooted or scene.format == "plain" or scene.dataset not in SHIPPED_DATASETS


def read_rows(path: Path) -> list[tuple[int, dict[str, Any]]]:
    """Read each row of a table with its line number. Blank lines and lines that begin with # are skipped.

    UserError: it is missing or unreadable, or a row has not the columns. Values are not checked."""
    if not path.exists():
        raise UserError(f"{path}: does not exist; the configuration key 'scenes' names it")
    columns, lines = [*Row.model_fields], enumerate(read_user_text(path).split("\n"), 1)
    cells = {number: line.rstrip("\r").split("\t") for number, line in lines if re.match(r"\s*[^\s#]", line)}
    (first, head), *rows = cells.items() or [(1, [])]
    if head != columns:
        needs = f"has columns {ascii(head)[:200]}; needs {', '.join(columns)}, tab-separated, above all rows"
        raise UserError(f"{path}, line {first}: {needs}")
    for number, row in rows:
        if len(row) != len(columns):
            has = f"{path}, line {number}: has {len(row)} of the {len(columns)} columns {', '.join(columns)}"
            raise UserError(f"{has}; put one tab between two of them, for an empty one too")
    return [(number, dict(zip(columns, row, strict=True))) for number, row in rows]


def given_recording(row: Mapping[str, str], config: Config) -> Path:
    """Get the path of a row's recording, which may be relative to the folder of its dataset."""
    return expand_home(config["data_root"].get(row["dataset"]) or ".") / expand_home(row["recording"])


def scene_of_row(row: dict[str, Any], config: LayeredConfig, where: str, real: str = PHOTOS) -> Scene:
    """Make the scene of a row, its values by column (UserError: a value is wrong; begins with ``where``); ``real`` is the set of
    models of a real recording for which nothing chooses one."""
    make_options(Row, row, where, "")
    dataset, name, format = row["dataset"], row["scene"], row["format"]
    options = parse_options(row["options"], where)
    if common := {"data_root", "formats"} & options.keys():
        raise UserError(f"{where}: {min(common)} holds for all scenes; set it in config/config.yaml")
    root = config["data_root"].get(dataset)
    filmed = format == "adt" and "seed" in options.get("synthetic", {})
    by_name = row["recording"] == "-"
    if by_name and not filmed:
        needs = "give the format adt and the option synthetic.seed, or a recording"
        raise UserError(f"{where}: recording - is a synthetic apartment; {needs}")
    synthetic = filmed and (root is None or by_name)
    recording = Path("results", dataset, name, "recording") if synthetic else given_recording(row, config)
    try:
        rendered = synthetic or recording_origin(format, recording) == "synthetic"
    except UserError:
        rendered = False  # the stage frames reports what is wrong with the recording
    # The small models know only what egosplat renders.
    own = of_format(config, format, Layer(where, options), automatic=SMALL if rendered else real)
    locate_checkpoints(own)  # ends here if the catalogue has no checkpoint of an architecture
    return Scene(dataset, name, format, recording, synthetic, own, by_name, rendered)
