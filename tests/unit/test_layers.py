"""Imports point down the table of rooms in docs/architecture.md, and no stage imports another stage."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from egosplat.pipeline.code_hash import modules_of
from egosplat.pipeline.stages import STAGES
from tests.support import ROOT

PACKAGE = ROOT / "src" / "egosplat"
APARTMENTS = ROOT / "src" / "egosplat_apartments"
RIVALS = ROOT / "src" / "egosplat_rivals"


def layers(page: str) -> list[tuple[str, ...]]:
    """The rooms of each row of the table of rooms, from the top down."""
    section = page.partition("## Rooms\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]+`) \|", section, re.MULTILINE)
    return [tuple(re.findall(r"`(\w+)`", row)) for row in rows]


def arrows(package: Path) -> Iterator[tuple[str, str, str]]:
    """Each import of one room by another: file, importing room, imported room."""
    # The package itself names what is public, from any room.
    for path in sorted(set(package.rglob("*.py")) - {package / "__init__.py"}):
        room = path.relative_to(package).parts[0].removesuffix(".py")
        for name in imports_of(path):
            root, _, below = name.partition(".")
            other = below.partition(".")[0]
            if root == package.name and other not in ("", room) and not other.startswith("__"):
                yield path.relative_to(package).as_posix(), room, other


def imports_of(path: Path) -> Iterator[str]:
    """The name of everything that a file imports, also inside functions."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_the_table_names_every_room():
    named = [room for row in layers((ROOT / "docs/architecture.md").read_text()) for room in row]
    files = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"}
    folders = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert sorted(named) == sorted(files | folders)


def test_imports_point_down():
    rows = layers((ROOT / "docs/architecture.md").read_text())
    level = {room: index for index, row in enumerate(rows) for room in row}
    up = [
        f"{path}: {room} imports {other}"
        for path, room, other in arrows(PACKAGE)
        # What the package offers by name, ``__init__``, stands above all rooms.
        if room != "__init__" and level[room] >= level[other]
    ]
    assert up == []


def test_the_synthetic_world_imports_small_libraries_alone():
    libraries = {"errors", "files", "geometry", "images", "progress"}
    libraries |= {f"pipeline.{name}" for name in ("home", "options", "shared_options", "code_hash", "stage")}
    allowed = tuple(f"egosplat.{library}." for library in libraries)
    names = {f"{name}." for path in APARTMENTS.rglob("*.py") for name in imports_of(path)}
    assert not {name for name in names if name.startswith("egosplat.") and not name.startswith(allowed)}


def test_packages_do_not_import_those_beside_them():
    beside = {PACKAGE: ("egosplat_",), APARTMENTS: ("egosplat_rivals",), RIVALS: ("egosplat_apartments",)}
    for package, others in beside.items():
        names = {name: path for path in package.rglob("*.py") for name in imports_of(path)}
        assert not {name: path for name, path in names.items() if name.startswith(others)}


def test_no_stage_but_synthetic_reaches_the_synthetic_world():
    for stage in STAGES.values():
        reached = any(name.startswith("egosplat_apartments") for name in modules_of(stage.module))
        assert reached == (stage.name == "synthetic"), stage.name
