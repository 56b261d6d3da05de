"""Fixture of the kernel tests: other variants of the library, each in its own process."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.targets import HERE, VARIANTS


@pytest.fixture(params=VARIANTS, ids=lambda variant: variant.name)
def in_other_variant(request: pytest.FixtureRequest) -> Callable[[str, Path], None]:
    """Run a script, with a folder as its argument, with another variant than this process has loaded."""
    variant = request.param
    if variant.name == library.variant():
        pytest.skip("the other tests are of this one")
    if not (HERE / variant.file).is_file() or not variant.features <= library.cpu_features():
        pytest.skip("not built, or not for this processor")

    def run(script: str, folder: Path) -> None:
        environment = os.environ | {library.VARIABLE: variant.name}
        subprocess.run([sys.executable, "-c", script, str(folder)], env=environment, check=True)

    return run
