"""Fixture of the kernel tests: other variants of the library, each in its own process."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.targets import HERE, VARIANTS


@pytest.fixture(params=VARIANTS, ids=lambda variant: variant.name)
def in_other_variant(
    request: pytest.FixtureRequest, tmp_path: Path
) -> Callable[[str, list[torch.Tensor]], list[torch.Tensor]]:
    """``outputs`` that a script computes from ``inputs`` with another variant than this process has loaded."""
    variant = request.param
    if variant.name == library.variant():
        pytest.skip("the other tests are of this one")
    if not (HERE / variant.file).is_file() or not variant.features <= library.cpu_features():
        pytest.skip("not built, or not for this processor")

    def run(script: str, inputs: list[torch.Tensor]) -> list[torch.Tensor]:
        torch.save([tensor.detach() for tensor in inputs], tmp_path / "in.pt")
        code = f"import torch; inputs = torch.load('in.pt')\n{script}\ntorch.save(outputs, 'out.pt')"
        environment = os.environ | {library.VARIABLE: variant.name}
        subprocess.run([sys.executable, "-c", code], env=environment, cwd=tmp_path, check=True)
        return torch.load(tmp_path / "out.pt")

    return run
