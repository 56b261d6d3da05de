"""Variants of the library for other processors, each in its own process, have the same results."""

import os
import subprocess
import sys

import pytest
import torch
from torch import Tensor

from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.targets import HERE, VARIANTS
from tests.support.rooms import ROOT
from tests.unit.rasterize.kernels import test_raster, test_training


def outputs() -> list[Tensor]:
    """A parameter after a step, loss and gradient, and a composited image with its gradients."""
    state = test_training.tensors(21, 5)
    test_training.steps(state, 1)
    loss = test_training.value_and_gradient(*test_training.pictures(41, 27))
    values = test_raster.projected(2000, 18) | {"opacities": torch.full((2000,), 0.3)}
    return [each.detach() for each in (state[0], *loss, *test_raster.pull(values))]


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_other_variants_agree(variant, tmp_path) -> None:
    if library.why_not() is not None or variant.name == library.variant():
        pytest.skip("the other tests are of this one")
    if not (HERE / variant.file).is_file() or not variant.features <= library.cpu_features():
        pytest.skip("not built, or not for this processor")
    code = (
        f"import torch; from {__name__} import outputs; torch.save(outputs(), {str(tmp_path / 'out.pt')!r})"
    )
    environment = os.environ | {library.VARIABLE: variant.name}
    subprocess.run([sys.executable, "-c", code], env=environment, cwd=ROOT, check=True)
    for row, (found, expected) in enumerate(zip(torch.load(tmp_path / "out.pt"), outputs(), strict=True)):
        # At the edge of a Gaussian, rounding may change one pixel in a million.
        assert (found - expected).norm() < (1e-6 if row < 3 else 1e-4) * expected.norm()
