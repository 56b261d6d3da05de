"""Print the lines of Python of each room: ``python -m tests.support.lines``, a part of ``make lint``."""

from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2] / "src"


def count_lines(path: Path) -> int:
    """Count the lines of a Python file, or of all in a folder."""
    files = path.rglob("*.py") if path.is_dir() else [path]
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def list_rooms(package: Path) -> dict[str, int]:
    """Get the lines of each room of a package: its folders, and its single modules together; the largest first."""
    folders = {path.name: count_lines(path) for path in package.iterdir() if (path / "__init__.py").is_file()}
    modules = sum(count_lines(path) for path in package.glob("*.py"))
    return dict(sorted({**folders, "single modules": modules}.items(), key=lambda item: -item[1]))


def main() -> None:
    """Print a line for each room of each package, and the sums."""
    for package in sorted(path for path in SOURCE.iterdir() if (path / "__init__.py").is_file()):
        rooms = list_rooms(package)
        print(f"{sum(rooms.values()):6,} {package.name}: {len(rooms) - 1} rooms")
        for room, lines in rooms.items():
            print(f"{lines:6,}   {room}")


if __name__ == "__main__":
    main()
