"""What has to start quickly imports nothing heavy, and frames are read without annotation code."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[2] / "src"
PIPELINE = sorted(path.stem for path in (SOURCES / "egosplat/pipeline").glob("[!_]*.py"))
MODELS = {
    "sam2_config": "sam2.1_hiera_b+",
    "clip_model": "ViT-B-16",
    "sam2_checkpoint": "x",
    "clip_checkpoint": "x",
}


def imported_lines(code: str) -> list[str]:
    """What a program prints that imports modules, and these at its end."""
    words = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    environment = os.environ | {"PYTHONPATH": str(SOURCES)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def imported_by(code: str) -> set[str]:
    """The modules that a program imports."""
    return set(" ".join(imported_lines(code)).split())


@pytest.mark.parametrize(
    "code, heavy",
    [
        (
            "".join(f"import egosplat.pipeline.{one};" for one in PIPELINE),
            {"torch", "zarr", "cv2", "sam2", "open_clip", "pycolmap"},
        ),
        (
            "from egosplat.cli import cli; cli.get_command(None, 'query')",
            {"torch", "numpy", "matplotlib", "cv2", "zarr", "snakemake"},
        ),
        (
            f"from egosplat.models.checkpoints import model_hashes; model_hashes({{'models': {MODELS}}})",
            {"torch", "sam2", "open_clip", "hydra"},
        ),
    ],
    ids=["rules", "help of query", "hashes of models"],
)
def test_a_quick_start_imports_nothing_heavy(code, heavy):
    """Snakemake imports the pipeline for every job, and help is shown at once."""
    assert not heavy & imported_by(code)


WITH_THE_COMPILER = """
from egosplat.models.without_compiler import without_compiler
import torch
with without_compiler():
    import torchvision
    from torch._dynamo.utils import counters  # not in the stand-in
from torch._dynamo.utils import is_compile_supported
assert is_compile_supported.__module__ == "torch._dynamo.utils"
assert torch.compiler.disable.__module__ == "torch.compiler"
"""
WITHOUT_TRANSFORMERS = """
import tempfile
from pathlib import Path
with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "transformers.py").write_text("raise RuntimeError('was imported')")
    sys.path.insert(0, folder)
    import egosplat.viewing.words
assert "transformers" not in sys.modules
"""
MODULES = {
    name: f"import egosplat.{name}"
    for name in ("segments.masks", "transient.network", "viewing.words", "query.command")
}


@pytest.fixture(scope="module")
def imported_after_torch() -> dict[str, set[str]]:
    """The modules of several programs that import torch, each in its own copy of one process that has done so."""
    programs = MODULES | {"compiler": WITH_THE_COMPILER, "transformers": WITHOUT_TRANSFORMERS}
    code = f"""
import os, torch
for name, program in {programs}.items():
    sys.stdout.flush()
    if os.fork() == 0:
        exec(program)
        print(name, *sys.modules, flush=True)
        os._exit(0)
    os.wait()
os._exit(0)"""
    lines = map(str.split, imported_lines(code))
    return {name: set(modules) for name, *modules in lines}


@pytest.mark.parametrize("module", ["segments.masks", "transient.network", "viewing.words"])
def test_libraries_of_models_come_without_the_compiler_of_torch(imported_after_torch, module):
    """It takes twice as long to import as the libraries, and nothing here compiles."""
    found = imported_after_torch[module]
    assert f"egosplat.{module}" in found and not {"torch._dynamo", "torch._dynamo.utils"} & found


def test_the_compiler_of_torch_can_be_imported_later(imported_after_torch):
    """Its parts are its own, and it still excludes functions from compilation."""
    assert "torch._dynamo" in imported_after_torch["compiler"]


def test_open_clip_does_not_import_transformers(imported_after_torch):
    """A package with weights brings it along; its import takes seconds."""
    assert "open_clip.hf_model" in imported_after_torch["transformers"]


def test_the_words_of_a_query_need_no_matplotlib(imported_after_torch):
    """The answer is printed before the library of the picture is imported."""
    assert "matplotlib" not in imported_after_torch["query.command"]


def test_reading_frames_never_imports_annotation_code():
    """A change of annotation code makes no frames stale."""
    modules = imported_by(
        "import egosplat.frames.stage\n"
        "from egosplat.pipeline.stages import STAGES, load_module\n"
        "[load_module('frames', format) for format in STAGES['frames'].modules]"
    )
    assert "egosplat.frames.adt" in modules
    assert not [one for one in modules if one.startswith("egosplat.") and "annotation" in one]


def test_hashing_imports_nothing_that_a_stage_needs():
    """The code hash is computed before every job."""
    modules = imported_by(
        "from egosplat.pipeline.stages import STAGES, code_of; [code_of(name) for name in STAGES]"
    )
    own = {one for one in modules if one.startswith("egosplat.")}
    assert own == {
        *("egosplat.errors", "egosplat.files", "egosplat.pipeline"),
        *(f"egosplat.pipeline.{one}" for one in ("code_hash", "parsed_modules", "stage", "stages")),
    }
    assert not modules & {"numpy", "cv2"}
