"""The files of the packaged models are part of the package data."""

import tomllib
from pathlib import Path, PurePath

import pytest

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "src" / "egosplat"

KINDS = ["sam2.yaml", "model.safetensors", "open_clip_config.json", "bpe.txt.gz", "MODEL_CARD.md"]


@pytest.fixture
def is_installed():
    """Whether a file of the package is part of its data."""
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"][
        "egosplat"
    ]
    return lambda path: any(PurePath(path).match(pattern) for pattern in patterns)


@pytest.mark.parametrize("name", KINDS)
def test_the_files_of_a_packaged_model_are_installed(is_installed, name):
    assert is_installed(f"models/some_model/{name}")
    assert not is_installed(f"models/{name}")


def test_no_file_of_a_packaged_model_is_left_out(is_installed):
    files = [path.relative_to(PACKAGE) for path in (PACKAGE / "models").glob("*/*") if path.is_file()]
    left_out = [str(path) for path in files if path.suffix not in (".py", ".pyc") and not is_installed(path)]
    assert not left_out, "pyproject.toml: package-data"
