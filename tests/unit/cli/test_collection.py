"""Commands import libraries without Python's search for garbage, and search again afterwards."""

import gc
import subprocess
import sys

import pytest

from egosplat.cli.flags import without_collection


@pytest.fixture(autouse=True)
def collecting():
    """Other tests find the collector as this one did."""
    enabled = gc.isenabled()
    gc.enable()
    yield
    (gc.enable if enabled else gc.disable)()


def test_nothing_is_searched_inside_the_context_nor_again_after_it():
    before = gc.get_freeze_count()
    with without_collection():
        assert not gc.isenabled()
        kept = [[number] for number in range(100)]
    assert gc.isenabled() and gc.get_freeze_count() >= before + len(kept)


def test_a_command_frees_no_objects_one_by_one_when_it_ends():
    """Python's last search came after what was registered first: it finds everything frozen."""
    code = "import atexit, gc; atexit.register(lambda: print(len(gc.get_objects())))\n"
    words = [sys.executable, "-c", f"{code}from egosplat.cli import main; main()", "snakefile"]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    assert int(told.stdout.splitlines()[-1]) < 1000
