"""Compare the size of each room with its budget: ``python -m tests.support.rooms``, a part of ``make lint``.

``rooms.toml`` holds lines of Python for the rooms of each package, the folders of tests, and benchmarks and training, and words for the pages. A room
above its budget fails, and so does a change that raises a sum of budgets. ``--lower`` writes today's counts where they are lower.
"""

import argparse
import subprocess
import sys
import tomllib
from pathlib import Path

from tests.support import ROOT

BUDGETS = ROOT / "rooms.toml"
SINGLE = "single modules"

Sizes = dict[str, dict[str, int]]


def count_lines(path: Path) -> int:
    """Count the lines of a Python file, or of all in a folder."""
    files = path.rglob("*.py") if path.is_dir() else [path]
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def count_words(folder: Path) -> int:
    """Count the words of all Markdown pages below a folder."""
    return sum(len(page.read_text(encoding="utf-8").split()) for page in folder.rglob("*.md"))


def list_rooms(package: Path) -> dict[str, int]:
    """Get the lines of each room of a package: its folders, and its single modules together."""
    folders = {path.name: count_lines(path) for path in sorted(package.iterdir()) if any(path.rglob("*.py"))}
    return {**folders, SINGLE: sum(count_lines(path) for path in package.glob("*.py"))}


def measure(root: Path = ROOT) -> Sizes:
    """Get today's size of each room, by table of rooms.toml."""
    packages = sorted(path.parent for path in (root / "src").glob("*/__init__.py"))
    tables = {f"src/{package.name}": list_rooms(package) for package in packages}
    tables["tests"] = list_rooms(root / "tests")
    tables["beside"] = {name: count_lines(root / name) for name in ("benchmarks", "training")}
    pages = {name: count_words(root / name) for name in ("docs", "benchmarks")}
    return {**tables, "words": pages | {"CHANGELOG.md": len((root / "CHANGELOG.md").read_text().split())}}


def over_budget(sizes: Sizes, budgets: Sizes) -> list[str]:
    """Get a line for each room that is larger than its budget, or has none."""
    return [
        f"{table}, {room}: {size:,} of {budgets.get(table, {}).get(room, 0):,}"
        for table, rooms in sizes.items()
        for room, size in rooms.items()
        if size > budgets.get(table, {}).get(room, 0)
    ]


def raised_sums(old: Sizes, new: Sizes) -> list[str]:
    """Get a line for each kind of budget whose sum grew: all packages together, the tests, the words."""

    def total(budgets: Sizes, kind: str) -> int:
        return sum(sum(rooms.values()) for table, rooms in budgets.items() if table.startswith(kind))

    kinds = ("src", "tests", "beside", "words")
    return [
        f"{kind}: budgets grew from {total(old, kind):,} to {total(new, kind):,}; lower others by as much"
        for kind in kinds
        if total(new, kind) > total(old, kind) > 0
    ]


def lowered(sizes: Sizes, budgets: Sizes) -> Sizes:
    """Get budgets that are at most today's sizes, without rooms that are gone. Other tables stay."""
    lower = {
        table: {room: min(size, budgets.get(table, {}).get(room, 0)) for room, size in rooms.items()}
        for table, rooms in sizes.items()
    }
    return budgets | lower


def write_budgets(budgets: Sizes, path: Path = BUDGETS) -> None:
    """Write rooms.toml."""
    head = "# Lines of Python a room, words a folder of pages: python -m tests.support.rooms.\n"
    tables = (
        f'\n["{table}"]\n' + "".join(f'"{room}" = {size}\n' for room, size in rooms.items())
        for table, rooms in budgets.items()
    )
    path.write_text(head + "".join(tables), encoding="utf-8")


def earlier_budgets() -> Sizes | None:
    """Get the budgets before the last change of rooms.toml; None outside of a repository or without an earlier text."""

    def git(*words: str) -> str:
        run = subprocess.run(["git", "-C", str(ROOT), *words], check=False, capture_output=True, text=True)
        return run.stdout if run.returncode == 0 else ""

    if git("show", "HEAD:rooms.toml") != BUDGETS.read_text(encoding="utf-8"):
        return tomllib.loads(git("show", "HEAD:rooms.toml")) or None
    commit = git("log", "-1", "--format=%H", "--", "rooms.toml").strip()
    return tomllib.loads(git("show", f"{commit}^:rooms.toml")) or None


def main() -> None:
    """Print a line for each table, and end with 1 where a room is over its budget or a sum grew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lower", action="store_true", help="lower budgets to today's sizes")
    arguments = parser.parse_args()
    sizes, budgets = measure(), tomllib.loads(BUDGETS.read_text(encoding="utf-8"))
    if arguments.lower:
        budgets = lowered(sizes, budgets)
        write_budgets(budgets)
    for table, rooms in sizes.items():
        print(f"{sum(rooms.values()):7,} of {sum(budgets.get(table, {}).values()):7,}  {table}")
    faults = over_budget(sizes, budgets) + raised_sums(earlier_budgets() or budgets, budgets)
    sys.exit("\n".join(["rooms.toml:", *faults]) if faults else 0)


if __name__ == "__main__":
    main()
