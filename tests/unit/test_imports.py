"""What has to start quickly imports nothing heavy, and frames are read without annotation code."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[2] / "src"
PIPELINE = sorted(path.stem for path in (SOURCES / "egosplat/pipeline").glob("[!_]*.py"))
MODELS = {"sam2_config": "sam2.1_hiera_b+", "clip_model": "ViT-B-16"}
MODELS |= dict.fromkeys(("sam2_checkpoint", "clip_checkpoint"), "x")


def imported_lines(code: str) -> list[str]:
    words = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    environment = os.environ | {"PYTHONPATH": str(SOURCES)}
    return subprocess.check_output(words, env=environment, text=True).splitlines()


def imported_by(code: str) -> set[str]:
    return set(" ".join(imported_lines(code)).split())


ASK_FOR_HASHES = "from egosplat.models.checkpoints import model_hashes; model_hashes"
QUICK = {
    "rules": (
        "".join(f"import egosplat.pipeline.{one};" for one in PIPELINE),
        "torch zarr cv2 sam2 pycolmap",
    ),
    "help": (
        "from egosplat.cli import cli; cli.get_command(None, 'query')",
        "torch numpy cv2 zarr snakemake",
    ),
    "hashes of models": (f"{ASK_FOR_HASHES}({{'models': {MODELS}}})", "torch sam2 open_clip hydra"),
}


@pytest.mark.parametrize("program", QUICK)
def test_a_quick_start_imports_nothing_heavy(program):
    code, heavy = QUICK[program]
    assert not {*heavy.split(), "open_clip", "matplotlib"} & imported_by(code)


def test_threads_of_torch_that_wait_do_not_spin():
    code = "import os; os.environ.pop('OMP_WAIT_POLICY', None); import egosplat; print(os.environ['OMP_WAIT_POLICY'])"
    assert imported_lines(code)[0] == "passive"


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
MODULES = {name: f"import egosplat.{name}" for name in ("segments.masks", "viewing.words", "query.command")}
MODULES["transient"] = """
from egosplat.transient.objective import InitialObjective
from egosplat.transient.stage import TransientOptions, make_network
objective = InitialObjective(make_network(64, False, None, 0), TransientOptions(warmup=0), torch.device("cpu"))
objective.load_state_dict(objective.state_dict() | {"iteration": 1})
for weight in objective.net.parameters():
    weight.grad = torch.ones_like(weight)
objective.step()
"""


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


COMPILER = {"torch._dynamo", "torch._dynamo.utils"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "program, imported, left_out",
    [
        # It takes twice as long to import as the libraries of models, and nothing here compiles.
        ("segments.masks", "egosplat.segments.masks", COMPILER),
        ("transient", "egosplat.transient.objective", COMPILER),
        ("viewing.words", "egosplat.viewing.words", COMPILER),
        # It can be imported later: its parts are its own.
        ("compiler", "torch._dynamo", set()),
        # A package with weights brings transformers along, whose import takes seconds.
        ("transformers", "open_clip.hf_model", {"transformers"}),
        # The answer is printed before the library of the picture is imported.
        ("query.command", "egosplat.query.command", {"matplotlib"}),
    ],
)
def test_what_takes_long_is_imported_where_it_is_used(imported_after_torch, program, imported, left_out):
    found = imported_after_torch[program]
    assert imported in found and not left_out & found


def test_reading_frames_never_imports_annotation_code_and_always_the_codec_of_pictures():
    assert "egosplat.artifacts.jpeg" in imported_by("import egosplat.artifacts.reader")
    modules = imported_by(
        "import egosplat.frames.stage\n"
        "from egosplat.pipeline.stages import STAGES, load_module\n"
        "[load_module('frames', format) for format in STAGES['frames'].modules]"
    )
    assert "egosplat.frames.adt" in modules
    assert not [one for one in modules if one.startswith("egosplat.") and "annotation" in one]


def test_hashing_imports_nothing_that_a_stage_needs():
    """The code hash is computed before every job."""
    code = "from egosplat.pipeline.stages import STAGES, code_of; [code_of(name) for name in STAGES]"
    modules = imported_by(code)
    own = {one for one in modules if one.startswith("egosplat.")}
    assert own == {
        *("egosplat.errors", "egosplat.files", "egosplat.pipeline"),
        *(f"egosplat.pipeline.{one}" for one in ("code_hash", "parsed_modules", "stage", "stages")),
    }
    assert not modules & {"numpy", "cv2"}
