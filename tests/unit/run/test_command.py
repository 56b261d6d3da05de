"""The command line of ``egosplat run``, and the call of Snakemake."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from egosplat.cli import cli, scenes
from egosplat.errors import UserError
from egosplat.files import alone
from egosplat.pipeline.home import CONFIG, find_home, make_command
from egosplat.pipeline.stages import STAGES
from egosplat.run import command
from egosplat.run.command import make_scene
from tests.support import ROOT
from tests.unit.run.conftest import write_pictures


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """The words of each call of Snakemake, which does nothing, in an empty folder beside some photographs."""
    write_pictures(tmp_path / "photos")
    (work := tmp_path / "work").mkdir()
    monkeypatch.chdir(work)
    found = []
    monkeypatch.setattr(command, "run_snakemake", lambda words: found.append(words) or 0)
    return found


def test_the_workflow_runs_from_an_empty_folder(calls, tmp_path):
    scene = make_scene(tmp_path / "photos", preset="draft", cores=3, options=("frames.stride=2",))
    (words,) = calls
    assert words[:5] == ["snakemake", "--snakefile", str(ROOT / "workflow/Snakefile"), "--cores", "3"]
    names = ("scene.html", *(f"{name}.zarr" for name in STAGES["scene_page"].inputs))
    assert words[5:] == ["--config", "preset=draft", "--", *(f"results/mine/photos/{name}" for name in names)]
    assert scene.config["frames"]["stride"] == 2
    with alone(scene.results, "a scene"), pytest.raises(UserError, match=f"kill {os.getpid()}"):
        make_scene(tmp_path / "photos")
    assert [str(path) for path in Path(".").rglob("*") if path.is_file()] == ["config/scenes.local.tsv"]


def test_missing_weights_are_told_before_the_first_step(calls, tmp_path):
    with pytest.raises(UserError, match="models.sam2_checkpoint.*\n.*egosplat models download"):
        make_scene(tmp_path / "photos", options=("models.set=published",))
    assert not calls


def test_the_workflow_of_the_working_directory_is_taken_first(calls, tmp_path):
    Path("workflow").mkdir()
    shutil.copy(ROOT / "workflow/Snakefile", "workflow")
    make_scene(tmp_path / "photos", name="kitchen")
    assert "--snakefile" not in calls[0] and "results/mine/kitchen/scene.html" in calls[0]


@pytest.mark.parametrize("place", ["Snakefile", "workflow/Snakefile"])
def test_the_project_of_another_workflow_is_left_alone(calls, tmp_path, place):
    for path, text in ((place, "rule all:\n"), ("config/config.yaml", "samples: [a]\n")):
        Path(path).parent.mkdir(exist_ok=True)
        Path(path).write_text(text)
    make_scene(tmp_path / "photos")
    assert calls[0][1:3] == ["--snakefile", str(ROOT / "workflow/Snakefile")]
    assert find_home(CONFIG) == ROOT / "config/config.yaml"
    assert make_command(Path("results/mine/photos/scene.html")).startswith("snakemake --snakefile ")


def test_a_hushed_run_tells_what_was_said_only_if_it_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(command, "is_hushed", lambda: True)
    for status in (0, 1):
        (tmp_path / "pretended.py").write_text(f"print('said'); raise SystemExit({status})")
        assert command.run_snakemake(["pretended"]) == status == capsys.readouterr().err.count("said")


def test_what_to_ask_is_told_and_asked_and_the_browser_opens(calls, tmp_path, monkeypatch, run_command):
    shown, asked = [], []
    monkeypatch.setattr("egosplat.viewing.command.show", lambda server, folder, options: shown.append(folder))
    monkeypatch.setattr("webbrowser.open", shown.append)
    run = ["run", str(tmp_path / "photos"), "--name", "home/hall"]
    told = run_command(*run)[2]
    assert "egosplat query results/home/hall " in told and "egosplat view results/home/hall" in told
    assert " MB; " in told and "results/home/hall/scene.html; logs: logs/home/hall\n" in told
    monkeypatch.setattr(scenes.query, "callback", lambda folder, words, options: asked.extend(words))
    assert run_command(*run, "--cores", 2, "--words", "couch", "cup")[0] == 0 and asked == ["couch", "cup"]
    assert [run_command(*run, *one)[0] for one in (["--words"], ["couch"], ["--words", " "])] == [2, 2, 2]
    assert run_command(*run, "--quiet") == (0, "", "")
    assert "'query'" in CliRunner().invoke(cli, ["qurey"]).output
    assert not shown and CliRunner().invoke(cli, [*run, "--open"]).exit_code == 0
    assert "http://127.0.0.1:" in shown[0] and shown[1:] == [Path("results/home/hall")]


SNAKEMAKE = """
import pathlib, signal, time
try:
    print("begun", flush=True)
    time.sleep(600)
except KeyboardInterrupt:
    time.sleep(0.2)
    pathlib.Path("ended").write_text("as asked")
    raise SystemExit(1)
"""
CALLER = """
from egosplat.run.command import run_snakemake
try:
    run_snakemake(["pretended"])
except KeyboardInterrupt:
    raise SystemExit(130)
"""


@pytest.mark.parametrize("ending, way", [(signal.SIGINT, "default"), (signal.SIGTERM, "ignore")])
def test_snakemake_ends_first_and_once(tmp_path, ending, way):
    """Only ``egosplat run`` gets the signal, as from a scheduler; Snakemake then removes what is unfinished."""
    (tmp_path / "pretended.py").write_text(SNAKEMAKE)
    path = os.pathsep.join([str(ROOT / "src"), str(tmp_path)])
    # What a script starts in the background ignores interrupts.
    process = subprocess.Popen(
        ["env", f"--{way}-signal=INT", sys.executable, "-c", CALLER],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    process.send_signal(ending)
    assert process.wait(timeout=300) == 130
    assert (tmp_path / "ended").read_text() == "as asked"


def test_a_trained_splat_becomes_a_key_of_the_scene(calls, tmp_path):
    """A file that is missing or has a space, which no row can hold, is named, and so is what is no key with its value."""
    for pair in ("frames.stride", "frames.stride=2 frames.end_s=3"):
        with pytest.raises(UserError, match="--set frames.stride"):
            make_scene(tmp_path / "photos", options=(pair,))
    (tmp_path / "scene.ply").touch()
    (tmp_path / "my scene.ply").touch()
    for name, status in (("scene.ply", 0), ("my scene.ply", 2), ("absent.ply", 2)):
        done = CliRunner().invoke(cli, ["run", str(tmp_path / "photos"), "--splat", str(tmp_path / name)])
        assert done.exit_code == status, done.output
        assert (name in done.stderr) == bool(status)
    assert len(calls) == 1
    row = Path("config/scenes.local.tsv").read_text().splitlines()[-1]
    assert row.split("\t")[-1].split()[-1] == f"splats.source={tmp_path / 'scene.ply'}"
