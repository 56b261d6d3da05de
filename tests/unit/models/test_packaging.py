"""The files of the packaged models are part of the package data."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "src" / "egosplat"


def test_no_file_of_a_packaged_model_is_left_out():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["egosplat"]
    files = [path.relative_to(PACKAGE) for path in (PACKAGE / "models").glob("*/*") if path.is_file()]
    data = [path for path in files if path.suffix not in (".py", ".pyc")]
    left_out = [str(path) for path in data if not any(map(path.match, patterns))]
    assert data and not left_out, "pyproject.toml: package-data"
