"""Compilation: one library per variant, only after a change, and installation never fails without a compiler."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from compiling import compile_kernels
from egosplat.rasterize.kernels.targets import VARIANTS, Variant, source_hash

GENERIC = VARIANTS[-1:]
SOURCE = """
#include <omp.h>
extern "C" const char* egosplat_source_hash(void) { return EGOSPLAT_SOURCE_HASH; }
extern "C" int egosplat_threads(void) { return omp_get_max_threads(); }
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with one source, and an environment without CXX and CXXFLAGS."""
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.delenv("CXXFLAGS", raising=False)
    (tmp_path / "source").mkdir()
    (tmp_path / "source/kernels.cpp").write_text(SOURCE)
    return tmp_path


@pytest.fixture
def compiler():
    if not (path := shutil.which("g++")):
        pytest.skip("g++ is absent; install it to test the compilation")
    return path


@pytest.fixture
def inode() -> Iterator[Callable[[Path], int]]:
    """Number of the file while it is held open, so that no new file can get the same number."""
    with ExitStack() as held:
        yield lambda path: os.fstat(held.enter_context(path.open("rb")).fileno()).st_ino


def test_compiles_once_for_the_same_sources_and_command(folder, compiler, monkeypatch, inode):
    assert compile_kernels(folder, folder, GENERIC) == []
    library = folder / "libegosplat_generic.so"
    assert source_hash(folder).encode() in library.read_bytes()
    assert {path.name for path in folder.iterdir()} == {"source", library.name}
    first = inode(library)

    os.utime(library, (0, 0))
    compile_kernels(folder, folder, GENERIC)
    assert inode(library) == first
    assert library.stat().st_mtime >= (folder / "source/kernels.cpp").stat().st_mtime

    (folder / "source/kernels.cpp").write_text("// Why.\n" + SOURCE)
    compile_kernels(folder, folder, GENERIC)
    assert inode(library) == first

    monkeypatch.setenv("CXXFLAGS", "-DMORE=1")
    compile_kernels(folder, folder, GENERIC)
    assert (second := inode(library)) != first

    (folder / "source/kernels.cpp").write_text(SOURCE + "extern int more;")
    compile_kernels(folder, folder, GENERIC)
    assert inode(library) != second


def test_an_unsupported_variant_is_skipped_with_a_note(folder, compiler):
    future = Variant("future", ("-march=x86-64-v99",), frozenset())
    (note,) = compile_kernels(folder, folder, [future, *GENERIC])
    assert "variant future" in note and "x86-64-v99" in note
    assert not (folder / future.file).exists()
    assert (folder / GENERIC[0].file).exists()


@pytest.mark.parametrize("command", ["", "no-such-compiler"])
def test_a_missing_compiler_gives_one_line_and_no_error(folder, monkeypatch, command):
    stale = folder / GENERIC[0].file
    stale.write_bytes(b"of older sources")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CXX", command)
    (note,) = compile_kernels(folder, folder, GENERIC)
    assert "apt install g++" in note and "\n" not in note
    assert not stale.exists()


@pytest.mark.parametrize("lacking", ["omp.h", "__builtin_shufflevector"])
def test_a_compiler_without_openmp_or_older_than_gcc_12_is_reported_in_one_line(folder, monkeypatch, lacking):
    (script := folder / "cxx").touch(0o755)
    script.write_text(f"#!/bin/sh\ngrep -q {lacking} || exit 0\necho 'error: no {lacking}' >&2\nexit 1\n")
    monkeypatch.setenv("CXX", str(script))
    (note,) = compile_kernels(folder, folder, GENERIC)
    assert f"no {lacking}" in note and "GCC 12" in note and "\n" not in note


def test_a_compiler_error_is_raised_with_its_output(folder, compiler):
    (folder / "source/kernels.cpp").write_text("int f( {")
    with pytest.raises(RuntimeError, match=r"kernels\.cpp:1"):
        compile_kernels(folder, folder, GENERIC)
    assert not (folder / GENERIC[0].file).exists()
