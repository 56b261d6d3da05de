"""The local table of scenes, which git ignores: one row for each recording that was given to ``egosplat run``."""

import re
from collections.abc import Mapping
from pathlib import Path

from egosplat.errors import UserError
from egosplat.files import read_user_text, write_text
from egosplat.pipeline.config import Config
from egosplat.pipeline.scenes import Scene, local_table, read_rows, scene_of_row, tables_of

# The dataset of a scene that is named without one.
DATASET = "mine"


def split_name(name: str) -> tuple[str, str]:
    """Split ``dataset/scene``; a name without a dataset is one of ``mine`` (UserError: it has another form)."""
    if (found := re.fullmatch(r"(?:(?!benchmark/)([a-z0-9_]+)/)?([A-Za-z0-9_-]+)", name)) is None:
        raise UserError(
            f"--name {name}: is no dataset/scene, as in mine/kitchen_2: dataset of small letters, digits and _, and not "
            "benchmark; scene of letters, digits, _ and -"
        )
    return found[1] or DATASET, found[2]


def put_row(config: Config, row: Mapping[str, str]) -> Scene:
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
