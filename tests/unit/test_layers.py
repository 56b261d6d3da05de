"""Imports point down the table of rooms in docs/architecture.md, and no stage imports another stage."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "egosplat"


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
        for node in ast.walk(ast.parse(path.read_bytes())):
            for other in _rooms(node, package.name):
                if other != room:
                    yield path.relative_to(package).as_posix(), room, other


def _rooms(node: ast.AST, root: str) -> list[str]:
    names = []
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    elif isinstance(node, ast.ImportFrom) and node.module:
        names = [f"{node.module}.{alias.name}" for alias in node.names]
    parts = [name.split(".") for name in names]
    return [part[1] for part in parts if part[0] == root and len(part) > 1 and not part[1].startswith("__")]


def arrows_up(package: Path, rows: list[tuple[str, ...]]) -> list[str]:
    """The imports that do not point down the rows."""
    level = {room: index for index, row in enumerate(rows) for room in row}
    return [
        f"{path}: {room} imports {other}"
        for path, room, other in arrows(package)
        if level[room] >= level[other]
    ]


def test_the_table_names_every_room():
    """A new room has a row in docs/architecture.md; a room that is gone has none."""
    named = [room for row in layers((ROOT / "docs/architecture.md").read_text()) for room in row]
    rooms = {
        path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    assert sorted(named) == sorted(rooms - {"__init__"})


def test_imports_point_down():
    """No circle, no import of a higher room, and no stage that imports a stage."""
    assert arrows_up(PACKAGE, layers((ROOT / "docs/architecture.md").read_text())) == []
