"""The findings of ``egosplat doctor`` on a machine, and its exit status."""

import importlib.util
from types import SimpleNamespace

import pytest
import torch
import yaml

from egosplat.doctor import findings as doctor
from egosplat.doctor.findings import Finding, Mark
from egosplat.doctor.inputs import examine
from egosplat.errors import UserError
from egosplat.models.checkpoints import PHOTO_WEIGHTS
from egosplat.rasterize import cuda
from egosplat.rasterize.kernels import library
from tests.support.commands import run_command

HEADER = "dataset\tscene\tformat\trecording\toptions\n"


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
    models = {
        "sam2_config": "sam2.yaml",
        "sam2_checkpoint": "sam2.pt",
        "clip_model": str(tmp_path),
        "clip_checkpoint": "clip.bin",
    }
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


def test_a_missing_checkpoint_comes_with_the_command_that_fetches_it(folder):
    (folder / "clip.bin").unlink()
    finding = found()["OpenCLIP"]
    assert finding.mark == Mark.MISSING and "there is no file clip.bin" in finding.value
    assert "egosplat models download" in finding.advice
    assert marks()["SAM2"] == Mark.OK


def test_a_missing_gpu_is_an_error_only_where_keys_ask_for_it(folder):
    assert marks()["GPU"] == Mark.NOTE
    asked = found("run={device: cuda, backend: cuda}")
    assert asked["GPU"].mark == Mark.MISSING
    assert asked["GPU"].advice == "Set run.backend and run.device to auto"
    assert asked["models run on"].mark == Mark.MISSING


def test_missing_recordings_are_counted_and_named(folder):
    data = folder / "data"
    asked = f"data_root={{mine: {data}}}"
    finding = found(asked)["mine recordings"]
    assert finding.mark == Mark.MISSING and f"0 of 2 below {data}" in finding.value
    assert "data_root.mine" in finding.advice
    data.mkdir()
    (data / "b.mp4").touch()
    finding = found(asked)["mine recordings"]
    assert finding.mark == Mark.MISSING and "1 of 2" in finding.value
    assert f"a ({data / 'a.mp4'})" in finding.value and "b.mp4" not in finding.value
    (data / "a.mp4").touch()
    assert found(asked)["mine recordings"] == Finding(Mark.OK, "mine recordings", f"2 of 2 below {data}")


PLAIN, HOI4D, ADT = "mine\ts\tplain\t{}\t", "hoi4d\ts\thoi4d\t{}\t", "adt\ts\tadt\t{}\t"


@pytest.mark.parametrize(
    "row, root, mark",
    [
        (PLAIN.format("nowhere.mp4"), None, Mark.MISSING),
        (PLAIN.format("/nowhere/photos"), None, Mark.MISSING),
        (PLAIN.format("~/nowhere"), None, Mark.MISSING),
        (PLAIN.format("~/videos/a.mp4"), None, Mark.OK),
        (PLAIN.format("a.mp4"), "~/videos", Mark.OK),
        (HOI4D.format("ZY1/H1"), None, Mark.NOTE),  # the shipped table's, before a root is set
        (HOI4D.format("ZY1/H1"), "/nowhere", Mark.MISSING),
        (ADT.format("seq1"), None, Mark.NOTE),
        (ADT.format("seq1"), "/nowhere", Mark.MISSING),
        (ADT.format("seq1") + "synthetic.seed=1", None, Mark.OK),
        ("other\ts\tadt\tseq1\t", None, Mark.MISSING),
    ],
)
def test_a_missing_recording_is_an_error_for_rows_of_the_user(folder, monkeypatch, row, root, mark):
    monkeypatch.setenv("HOME", str(folder))
    (folder / "videos").mkdir()
    (folder / "videos/a.mp4").touch()
    (folder / "config/scenes.tsv").write_text(HEADER + row + "\n")
    dataset = row.partition("\t")[0]
    findings = found(*([f"data_root.{dataset}={root}"] if root else []))
    assert findings[f"{dataset} recordings"].mark == mark


@pytest.mark.parametrize(
    "file, content, said",
    [
        ("sam2.pt", b"rubbish", " 7 bytes"),
        ("sam2.pt", b"", " 0 bytes"),
        ("clip.bin", b"version https://git-lfs.github.com/spec/v1\n", "clip.bin: "),
    ],
)
def test_a_damaged_checkpoint_is_an_error(folder, file, content, said):
    (folder / file).write_bytes(content)
    finding = found()["SAM2" if file == "sam2.pt" else "OpenCLIP"]
    assert finding.mark == Mark.MISSING and said in finding.value


def test_missing_encoder_weights_are_an_error(folder):
    assert "encoder" not in found()
    asked = f"transient.encoder_weights={folder / 'encoder.pt'}"
    assert found(asked)["encoder"].mark == Mark.MISSING
    assert "egosplat models download" in found(asked)["encoder"].advice
    torch.save({"weight": torch.zeros(2)}, folder / "encoder.pt")
    assert found(asked)["encoder"].mark == Mark.OK


def test_small_checkpoints_are_noted_for_each_real_scene(folder):
    for name in ("a.mp4", "b.mp4"):
        (folder / name).touch()
    assert "mine/a" not in found(), "these models are not the small ones"
    small = "models={set: small, clip_model: small, clip_checkpoint: small}"
    findings = found(small)
    for scene in ("mine/a", "mine/b"):
        assert findings[scene].mark == Mark.NOTE and "models.clip_checkpoint" in findings[scene].value
        assert "models.set to published" in findings[scene].advice
    assert "adt/s1" not in findings
    (folder / "b.mp4").unlink()
    assert "mine/b" not in found(small)


def test_words_for_photographs_are_checked_where_a_recording_takes_them(folder, monkeypatch):
    (folder / "config/config.yaml").write_text("")
    findings = found()
    assert findings["OpenCLIP"].value.startswith("small, ")
    assert "OpenCLIP, adt/s1" not in findings and "OpenCLIP, mine/b" not in findings, "each model once"
    assert findings["OpenCLIP, mine/a"].value.startswith("photos, ")
    assert "models.set photos" in findings["mine/a"].value and "to published" in findings["mine/a"].advice
    spec = importlib.util.find_spec
    hidden = PHOTO_WEIGHTS.module
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == hidden else spec(name))
    finding = found()["OpenCLIP, mine/a"]
    assert finding.mark == Mark.MISSING and f"pip install {PHOTO_WEIGHTS.name}" in finding.value


def test_kernels_that_do_not_load_are_an_error_only_where_keys_ask_for_them(folder, monkeypatch):
    monkeypatch.setattr(library, "why_not", lambda: "The C++ kernels are not compiled.\nRun make install")
    monkeypatch.setattr(library, "is_usable", lambda: False)
    assert found()["kernels"] == Finding(
        Mark.NOTE, "kernels", "The C++ kernels are not compiled.", "Run make install"
    )
    assert marks("run={backend: cpu}")["kernels"] == Mark.MISSING


def test_a_missing_reader_of_aria_recordings_is_noted(folder, monkeypatch):
    assert "projectaria-tools" not in found()
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: name != "projectaria_tools" and find(name) or None
    )
    assert found()["projectaria-tools"].mark == Mark.NOTE
    assert "pip install" in found()["projectaria-tools"].advice


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


def test_little_free_disk_is_noted(folder, monkeypatch):
    usage = type("Usage", (), {"free": 1024**3})
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _: usage)
    assert marks()["disk"] == Mark.NOTE


def test_a_wrong_table_of_scenes_is_a_finding(folder):
    (folder / "config/scenes.tsv").write_text("dataset\n")
    assert found()["scenes"].mark == Mark.MISSING


def test_a_wrong_configuration_is_an_error(folder):
    with pytest.raises(UserError, match="'models.sam'"):
        examine([], ["models={sam: small}"])


def test_the_exit_status_is_1_where_something_is_missing(folder, monkeypatch, capfd):
    status, text, _ = run_command(monkeypatch, capfd, "doctor")
    assert status == 0 and text.endswith("Nothing is missing.\n") and "\x1b" not in text
    (folder / "more.yaml").write_text("models: {sam2_checkpoint: /nowhere.pt}")
    words = ("doctor", "--configfile", "more.yaml", "--config", "preset=draft")
    status, text, _ = run_command(monkeypatch, capfd, *words)
    assert status == 1 and "missing  SAM2 " in text and "preset draft" in text
