"""Loading the kernels: the choice of a variant, and the messages if none can be loaded."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from compiling import compile_kernels
from egosplat.errors import UserError
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.library import choose, cpu_features, open_library
from egosplat.rasterize.kernels.targets import HERE, VARIANTS

AVX512, AVX2, GENERIC = VARIANTS
SOURCE = f"""
#include <omp.h>
extern "C" int egosplat_abi(void) {{ return {library.ABI}; }}
extern "C" const char* egosplat_source_hash(void) {{ return EGOSPLAT_SOURCE_HASH; }}
extern "C" int egosplat_team(void) {{
    int threads = 0;
    #pragma omp parallel
    if (omp_get_thread_num() == 0) threads = omp_get_num_threads();
    return threads;
}}
"""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory) -> Path:
    """A folder with a small source and its generic library."""
    if not shutil.which("g++"):
        pytest.skip("g++ is absent; install it to test the compilation")
    folder = tmp_path_factory.mktemp("kernels")
    (folder / "source").mkdir()
    (folder / "source/kernels.cpp").write_text(SOURCE)
    assert compile_kernels(folder, folder, [GENERIC]) == []
    return folder


@pytest.fixture
def folder(compiled, tmp_path) -> Path:
    """A private copy of the compiled folder."""
    return Path(shutil.copytree(compiled, tmp_path / "kernels"))


@pytest.fixture
def three(tmp_path) -> Path:
    """A folder with an empty file for each library."""
    for variant in VARIANTS:
        (tmp_path / variant.file).touch()
    return tmp_path


@pytest.mark.parametrize(
    "features, wanted, expected",
    [
        (AVX512.features, None, AVX512),
        (AVX2.features | {"avx512f"}, None, AVX2),
        (AVX2.features - {"fma"}, None, GENERIC),
        (frozenset(), None, GENERIC),
        *((AVX512.features, variant.name, variant) for variant in VARIANTS),
    ],
)
def test_the_best_supported_variant_or_the_wanted_one_is_chosen(three, features, wanted, expected):
    assert choose(three, features, wanted) == expected


def test_a_variant_that_is_not_compiled_is_skipped(three):
    (three / AVX512.file).unlink()
    assert choose(three, AVX512.features, None) == AVX2


@pytest.mark.parametrize(
    "features, wanted, words",
    [
        (AVX2.features, "avx512", ["EGOSPLAT_KERNEL=avx512", "lacks", "avx512bw"]),
        (AVX512.features, "sse9", ["EGOSPLAT_KERNEL=sse9", "avx512, avx2, generic"]),
        (AVX512.features, "avx2", ["EGOSPLAT_KERNEL=avx2", AVX2.file, "make install"]),
    ],
    ids=["processor", "name", "not compiled"],
)
def test_an_unsupported_variant_is_rejected(three, features, wanted, words):
    (three / AVX2.file).unlink()
    with pytest.raises(UserError) as caught:
        choose(three, features, wanted)
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize(
    ("left", "words"), [([], r"(?s)not compiled.*g\+\+.*make install"), ([AVX512, AVX2], "compiled kernels")]
)
def test_no_library_for_this_processor_is_reported(tmp_path, left, words):
    for variant in left:
        (tmp_path / variant.file).touch()
    with pytest.raises(UserError, match=words):
        choose(tmp_path, frozenset(), None)


@pytest.mark.parametrize(
    "text, expected",
    [
        ("flags\t\t: fpu avx2 fma\n\nprocessor\t: 1\nflags\t\t: fpu\n", {"fpu", "avx2", "fma"}),
        ("processor\t: 0\nFeatures\t: fp asimd\n", set()),
        (None, set()),
    ],
    ids=["x86", "arm", "absent"],
)
def test_features_are_read_from_cpuinfo(tmp_path, text, expected):
    if text is not None:
        (tmp_path / "cpuinfo").write_text(text)
    assert cpu_features(tmp_path / "cpuinfo") == expected


@pytest.mark.parametrize("threads", [1, 2])
def test_a_library_uses_torch_s_threads(folder, with_threads, threads):
    assert with_threads(threads, open_library(folder, GENERIC).egosplat_team) == threads


def test_a_library_links_to_no_openmp_runtime(folder):
    code = (
        "import sys; from pathlib import Path; from egosplat.rasterize.kernels import library, targets\n"
        "def runtimes(): return {line.split()[-1] for line in open('/proc/self/maps') if 'gomp' in line}\n"
        "before = runtimes()\n"
        "library.open_library(Path(sys.argv[1]), targets.VARIANTS[-1]).egosplat_team()\n"
        "assert before and runtimes() == before, (before, runtimes())"
    )
    done = subprocess.run([sys.executable, "-c", code, folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_stale_a_foreign_and_a_damaged_library_are_refused(folder):
    source = folder / "source/kernels.cpp"
    source.write_text("// Why.\n" + SOURCE)
    open_library(folder, GENERIC)
    source.write_text(SOURCE.replace("threads = 0", "threads = -1"))
    with pytest.raises(UserError, match=r"other sources.*make install"):
        open_library(folder, GENERIC)
    source.write_text(SOURCE.replace(f"return {library.ABI};", f"return {library.ABI + 1};"))
    compile_kernels(folder, folder, [GENERIC])
    with pytest.raises(UserError, match="make install"):
        open_library(folder, GENERIC)
    (folder / GENERIC.file).write_bytes(b"not a library")
    with pytest.raises(UserError, match="make install"):
        open_library(folder, GENERIC)


def test_the_package_imports_without_kernels(tmp_path):
    """A copy of the code without libraries can be imported and reports why the kernels are missing."""
    ignored = shutil.ignore_patterns("__pycache__", "*.so")
    shutil.copytree(HERE.parents[1], tmp_path / "egosplat", ignore=ignored)
    code = "from egosplat.rasterize.kernels.library import why_not; print(why_not())"
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert "not compiled" in done.stdout and str(tmp_path) in done.stdout


@pytest.fixture
def fresh():
    """Clear the loaded library before and after the test."""
    library._loaded.cache_clear()
    yield
    library._loaded.cache_clear()


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_the_installed_kernels_load_in_each_variant(variant, fresh, monkeypatch):
    if not (HERE / GENERIC.file).is_file():
        pytest.skip("the C++ kernels are not compiled; install g++ and run make install")
    if not (HERE / variant.file).is_file() or not variant.features <= cpu_features():
        pytest.skip(f"{variant.name} is not compiled, or this processor does not run it")
    monkeypatch.setenv(library.VARIABLE, variant.name)
    assert library.why_not() is None
    assert library.variant() == variant.name
    assert library._loaded() is library._loaded()
    library._loaded.cache_clear()
    monkeypatch.setenv(library.VARIABLE, "sse9")
    assert "EGOSPLAT_KERNEL=sse9" in library.why_not()
    with pytest.raises(UserError):
        library.variant()
