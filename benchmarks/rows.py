"""Rows of scored scenes beside a page, compressed: each query, held-out frame, whole-scene query and run."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click
import pandas as pd

from benchmarks.carries.places import read_places
from benchmarks.common import ROOT, survey_of
from egosplat.artifacts import provenance
from egosplat.errors import UserError
from egosplat.evaluation.queries import GROUPS
from egosplat.pipeline.validation import read_document
from egosplat.pipeline.variants import variant_folder
from egosplat.query.grades import Evidence
from egosplat_rivals.scored_scenes import FULL, ScoredScene, check_protocol, read_scored_scene

LEDGER = ROOT / "benchmarks" / "ledger"

ABOUT, TEXTS = "about.json", "texts.tsv"

# Source of the rows of all texts from the last change of scores on.
POOL = "ledger"

EVIDENCE = tuple(Evidence.__dataclass_fields__)

# Columns of each table after scene and setting.
COLUMNS = {
    "queries": ("group", "frame", "category", "hit", "iou", "random_hit", "middle_hit"),
    "frames": ("group", "frame", "pixels", "psnr", "ssim"),
    "presence": (
        *("phrase", "present", "score", "answered", "untaught", "right", "grade", "probability"),
        *EVIDENCE,
    ),
    "places": ("thing", "category", "from_s", "until_s", "told", "right"),
    "runs": ("cpu_s", "peak_memory_mb", "gaussians", "seed", "preset", "recording", "commit", "clean"),
}

# Setting that is scored with the poses of the recording; the others' are fitted to each held-out frame.
AS_GIVEN = "as_given"

# Decorator: where a benchmark of scored scenes keeps its rows, as ``rows``.
rows_option = click.option(
    "--rows", type=click.Path(path_type=Path), help="New folder for the rows: benchmarks/TOPIC/rows."
)


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one benchmark.

    Attributes:
        about: commit, machines, date, versions, and whatever else the benchmark tells.
        tables: by name, with the columns scene, setting and those of ``COLUMNS``.
    """

    about: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame]

    @property
    def settings(self) -> list[str]:
        """Names of the settings in their order."""
        return list(self.tables["runs"]["setting"].unique())

    @property
    def worlds(self) -> list[str]:
        """Names of the worlds of the scenes in their order."""
        return list(dict.fromkeys(map(world_of, self.tables["runs"]["scene"])))

    def within(self, world: str | None) -> "Rows":
        """The rows of the scenes of a world, such as ``busy`` for busy1 to busy5; all rows for None.

        Raises:
            UserError: there is no such scene.
        """
        if world is None:
            return self
        tables = {name: table[table["scene"].map(world_of) == world] for name, table in self.tables.items()}
        if tables["runs"].empty:
            raise UserError(f"{self.about['name']}: has no scene {world}1")
        return Rows(self.about, tables)

    def of(self, table: str, setting: str, **equal: Any) -> pd.DataFrame:
        """The rows of a setting whose columns have the given values.

        Raises:
            UserError: there is no such setting or group.
        """
        for what, value, known in (
            ("setting", setting, self.settings),
            ("group", equal.get("group", "all"), GROUPS),
        ):
            if value not in known:
                raise UserError(f"{self.about['name']}: has no {what} {value!r}; has {', '.join(known)}")
        rows = self.tables[table].query("setting == @setting")
        for column, value in equal.items():
            rows = rows[rows[column] == value]
        return rows


def world_of(scene: str) -> str:
    """World of a scene such as ``adt/busy1``: its name without its number; an apartment is usual."""
    name = re.sub(r"\d+$", "", scene.rpartition("/")[2])
    return "usual" if name == "apartment" else name


def read_scenes(folders: Sequence[Path], settings: Mapping[str, str | None]) -> dict[str, list[ScoredScene]]:
    """Scored scenes by setting, from the scenes' folders and the settings' variants, None for the scene's own.

    Raises:
        UserError: a file is missing, or scenes were queried or scored by different settings.
    """
    found = {
        setting: [read_scored_scene(folder / variant_folder(variant) / "metrics.json") for folder in folders]
        for setting, variant in settings.items()
    }
    check_protocol([one for setting, scenes in found.items() if setting != AS_GIVEN for one in scenes])
    return found


def collect(name: str, found: Mapping[str, list[ScoredScene]], **about: Any) -> Rows:
    """Rows of scored scenes by setting, with the places of carried things of ``FULL``; ``about`` is what else to tell of them."""
    listed: dict[str, list[tuple[Any, ...]]] = {table: [] for table in COLUMNS}
    for setting, scenes in found.items():
        for scene in scenes:
            places = read_places(scene.path.parent) if setting == FULL else []
            for table, row in (*_rows_of(scene), *(("places", place) for place in places)):
                listed[table].append((f"{scene.dataset}/{scene.scene}", setting, *row))
    tables = {
        table: pd.DataFrame(rows, columns=["scene", "setting", *COLUMNS[table]])
        for table, rows in listed.items()
    }
    return Rows(
        {"name": name, **_origin([one for scenes in found.values() for one in scenes]), **about}, tables
    )


def write_rows(folder: Path, rows: Rows) -> None:
    """Write a new folder of rows (UserError: it is there; rows are never replaced)."""
    if folder.exists():
        raise UserError(f"{folder}: is there; rows are not replaced. Move it away, or name another folder")
    made = folder.with_name(f".{folder.name}.tmp")
    made.mkdir(parents=True)
    for name, table in rows.tables.items():
        table.to_csv(made / f"{name}.csv.xz", index=False, float_format="%.6g")
    digests = {path.name: _digest(path) for path in sorted(made.iterdir())}
    (made / ABOUT).write_text(json.dumps({**rows.about, "digests": digests}, indent=1, sort_keys=True) + "\n")
    made.rename(folder)


def read_rows(folder: Path) -> Rows:
    """Read a folder of rows (UserError: there is none, or a table is not the one that was written)."""
    if not (folder / ABOUT).is_file():
        raise UserError(f"{folder}: has no rows ({ABOUT})")
    about = json.loads((folder / ABOUT).read_text())
    for name, digest in about["digests"].items():
        if _digest(folder / name) != digest:
            raise UserError(
                f"{folder / name}: is not the table that was written; get it back: git checkout {folder}"
            )
    tables = {name: pd.DataFrame(columns=["scene", "setting", *COLUMNS[name]]) for name in COLUMNS}
    return Rows(about, tables | {path.name[:-7]: pd.read_csv(path) for path in folder.glob("*.csv.xz")})


def read_texts() -> pd.DataFrame:
    """The registered texts in their order: ``text``, ``registered`` (date), ``scores`` (``changed`` or ``same`` against the
    text before), ``why``, and ``ran``, whether there are rows."""
    texts = pd.read_csv(LEDGER / TEXTS, sep="\t", dtype=str)
    return texts.assign(ran=[(LEDGER / text / ABOUT).is_file() for text in texts["text"]])


def read_pool() -> Rows:
    """The rows of all texts from the last change of scores on that has some; a setting has those of the texts that ran it."""
    texts = read_texts()
    versions = texts["scores"].eq("changed").cumsum()
    latest = texts["text"][texts["ran"] & (versions == versions[texts["ran"]].max())]
    read = [read_rows(LEDGER / text) for text in latest]
    about = {
        key: sorted({one for rows in read for one in rows.about[key]}) for key in ("commits", "machines")
    }
    tables = {name: pd.concat([rows.tables[name] for rows in read], ignore_index=True) for name in COLUMNS}
    return Rows({"name": f"{POOL}, {' and '.join(latest)}", "date": read[-1].about["date"], **about}, tables)


def read_source(name: str) -> Rows:
    """Read rows by their short name: a text of the ledger, ``POOL``, or a topic of benchmarks, ``:busy`` behind it for the scenes of a
    world (UserError: see ``read_rows`` and ``Rows.within``)."""
    name, _, world = name.partition(":")
    own = LEDGER / name if (LEDGER / name).exists() else ROOT / "benchmarks" / name / "rows"
    return (read_pool() if name == POOL else read_rows(own)).within(world or None)


def collect_page(
    topic: str, folders: Sequence[Path], settings: Mapping[str, str | None], rows: Path | None
) -> Rows:
    """Rows of scored scenes in their folders; writes them where asked, and prints what they were measured with.

    Raises:
        UserError: see ``read_scenes`` and ``write_rows``.
    """
    found = collect(topic, read_scenes(folders, settings))
    if rows is not None:
        write_rows(rows, found)
    click.echo(f"{stamp(found.about)}\n")
    return found


def stamp(about: Mapping[str, Any]) -> str:
    """The line of a page that names commit, machine and date."""
    return f"Commit {' and '.join(about['commits'])}, {'; '.join(about['machines'])}, {about['date']}."


def head() -> str:
    """The commit of a clean checkout.

    Raises:
        UserError: it is none.
    """
    found = provenance.checkout()
    if found["commit"] is None or not found["clean"]:
        raise UserError(
            f"{ROOT}: is no clean checkout; commit, or take a worktree of its own: git worktree add PATH"
        )
    return str(found["commit"])


def _origin(scenes: list[ScoredScene]) -> dict[str, Any]:
    records = [
        record
        for scene in scenes
        for record in (scene.document["provenance"], *scene.document["artifacts"].values())
        if record is not None
    ]
    return {
        "commits": sorted({_short(record) for record in records}),
        "machines": sorted({record.get("machine", "an unknown machine") for record in records}),
        "versions": dict(sorted(pair for record in records for pair in record["versions"].items())),
        "date": datetime.now(UTC).date().isoformat(),
    }


def _short(record: Mapping[str, Any]) -> str:
    commit = record.get("commit")
    return f"{commit[:12]}{'' if record['clean'] else ' with changes'}" if commit else "unknown"


def _rows_of(scene: ScoredScene) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Table and row of everything that ``metrics.json`` counts; the cost is that of all artifacts and of the survey."""
    document, survey = scene.document, survey_of(scene.path.parent)
    for query in document["queries"]:
        for group, truth in query["groups"].items():
            values = (int(truth["hit"]), truth["iou"], truth["random_hit"], int(truth["middle_hit"]))
            yield "queries", (group, query["frame"], query["category"], *values)
    for frame in document["frames"]:
        for group, region in frame["rendering"].items():
            yield "frames", (group, frame["frame"], region["pixels"], region["psnr"], region["ssim"])
    for asked in document.get("presence", {}).get("queries", ()):
        values = [(asked | (asked["evidence"] or {})).get(name) for name in COLUMNS["presence"]]
        yield "presence", tuple(int(value) if isinstance(value, bool) else value for value in values)
    own = [document, *([] if survey is None else [read_document(survey, "survey")])]
    records = [*filter(None, document["artifacts"].values()), *(one["provenance"] for one in own)]
    cost = (sum(one["cpu_s"] for one in records), max(one["peak_memory_mb"] for one in records))
    told = [document[name] for name in ("seed", "preset")] + [document["recording"]["hash"][:16]]
    yield "runs", (*cost, document["counts"].get("gaussians"), *told, document["commit"], document["clean"])


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
