"""A recording is the same on every processor, whatever instruction set the libraries choose."""

import os
import subprocess
import sys

import pytest

from egosplat.pipeline.config import defaults
from egosplat.rasterize.kernels.library import cpu_features
from egosplat_apartments.camera.effects import make_effects
from egosplat_apartments.camera.lens import make_lens
from egosplat_apartments.stage import SyntheticOptions, make_renderer, record_world
from egosplat_apartments.world.world import make_world
from tests.unit.apartments.conftest import SMALL_WORLD, digest_of

# Each variable makes a library choose the code path of another processor. Unknown names are ignored.
AVX512 = "NumPy without AVX-512"
LIMITS = {
    AVX512: {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
    "NumPy and OpenCV without AVX2 and IPP, OpenBLAS of an early processor": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "OPENBLAS_CORETYPE": "Nehalem",
        "OPENCV_CPU_DISABLE": "AVX512-SKX,AVX512-ICL,AVX2,FMA3",
        "OPENCV_IPP": "disabled",
    },
}


def record() -> str:
    world, digests = make_world(**SMALL_WORLD), []
    renderer = make_renderer(world, make_lens(96))
    for camera in ("ideal", "real"):
        effects = make_effects(SyntheticOptions(**defaults()["synthetic"] | {"camera": camera}))
        sequence = record_world(world, renderer, name="x", fps=1, seconds=3, effects=effects)
        digests.append(digest_of(sequence, sequence.frames()).hexdigest())
    return " ".join(digests)


def recording(limit: dict[str, str]) -> str:
    words = [sys.executable, "-c", f"from {__name__} import record; print(record())"]
    return subprocess.run(words, env=os.environ | limit, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def unlimited() -> str:
    return recording({})


@pytest.mark.slow
@pytest.mark.parametrize("name", LIMITS)
def test_a_recording_does_not_depend_on_the_instruction_set(name, unlimited):
    if name == AVX512 and "avx512f" not in cpu_features():
        pytest.skip("this processor has none")
    assert recording(LIMITS[name]) == unlimited
