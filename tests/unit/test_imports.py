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


def imported_by(code: str) -> set[str]:
    """The modules that a program imports."""
    words = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    environment = os.environ | {"PYTHONPATH": str(SOURCES)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "code, heavy",
    [
        (
            "".join(f"import egosplat.pipeline.{one};" for one in PIPELINE),
            {"torch", "zarr", "cv2", "sam2", "open_clip", "pycolmap"},
        ),
        ("import egosplat.pipeline.config", {"rfc3987_syntax"}),
        (
            "from egosplat.cli import cli; cli.get_command(None, 'query')",
            {"torch", "numpy", "matplotlib", "cv2", "zarr", "snakemake"},
        ),
        (
            f"from egosplat.models.checkpoints import model_hashes; model_hashes({{'models': {MODELS}}})",
            {"torch", "sam2", "open_clip", "hydra"},
        ),
    ],
    ids=["rules", "schemas", "help of query", "hashes of models"],
)
def test_a_quick_start_imports_nothing_heavy(code, heavy):
    """Snakemake imports the pipeline for every job, and help is shown at once."""
    assert not heavy & imported_by(code)


@pytest.mark.parametrize("module", ["segments.nms", "transient.network"])
def test_libraries_of_models_come_without_the_compiler_of_torch(module):
    """It takes twice as long to import as the libraries, and nothing here compiles."""
    assert not {"torch._dynamo", "torch._dynamo.utils"} & imported_by(f"import egosplat.{module}")


def test_the_compiler_of_torch_can_be_imported_later():
    """Its parts are its own, and it still excludes functions from compilation."""
    code = """
from egosplat.models.without_compiler import without_compiler
import torch
with without_compiler():
    import torchvision
    from torch._dynamo.utils import counters  # not in the stand-in
from torch._dynamo.utils import is_compile_supported
assert is_compile_supported.__module__ == "torch._dynamo.utils"
assert torch.compiler.disable.__module__ == "torch.compiler"
"""
    assert "torch._dynamo" in imported_by(code)


def test_open_clip_imports_neither_transformers_nor_timm_before_it_needs_it(tmp_path):
    """A package with weights brings transformers along. The import of each takes long."""
    (tmp_path / "transformers.py").write_text("raise RuntimeError('was imported')")
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
from egosplat.models.open_clip_loader import build_model
vision = {{"layers": 1, "width": 64, "patch_size": 32, "image_size": 32}}
text = {{"context_length": 8, "vocab_size": 64, "width": 64, "heads": 1, "layers": 1}}
build_model("own", {{"embed_dim": 8, "vision_cfg": vision, "text_cfg": text}})
assert not {{"transformers", "timm", "torch._dynamo"}} & {{*sys.modules}}
vision = {{"timm_model_name": "resnet18", "image_size": 32}}
model = build_model("of timm", {{"embed_dim": 8, "vision_cfg": vision, "text_cfg": text}})
assert type(model.visual.trunk).__module__ == "timm.models.resnet" and "transformers" not in sys.modules
"""
    assert "open_clip.hf_model" in imported_by(code)


def test_the_words_of_a_query_need_no_matplotlib():
    """The answer is printed before the library of the picture is imported."""
    assert "matplotlib" not in imported_by("import egosplat.query.command")


def test_reading_frames_never_imports_annotation_code():
    """A change of annotation code makes no frames stale."""
    modules = imported_by(
        "import egosplat.frames.stage\n"
        "from egosplat.pipeline.stages import STAGES, load_module\n"
        "[load_module('frames', format) for format in STAGES['frames'].modules.modules]"
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
        *(f"egosplat.pipeline.{one}" for one in ("source_hash", "code_hash", "parsed_modules", "stages")),
    }
    assert not modules & {"numpy", "cv2"}
