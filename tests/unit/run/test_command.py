"""The command line of ``egosplat run``, its table of scenes, and the call of Snakemake."""

import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import CliRunner

from egosplat.cli import cli, scenes
from egosplat.errors import UserError
from egosplat.files import alone
from egosplat.pipeline.config import defaults
from egosplat.pipeline.home import CONFIG, find_home, make_command
from egosplat.pipeline.scenes import read_scenes
from egosplat.pipeline.stages import STAGES
from egosplat.run import command
from egosplat.run.command import make_scene, put_row, split_name
from tests.support import HEADER, ROOT
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


def test_weights_that_cannot_be_fetched_are_told_before_the_first_step(calls, tmp_path):
    with pytest.raises(UserError, match="base_plus.*\n.*By hand"):
        make_scene(tmp_path / "photos", options=("models.set=published",))
    assert not calls


def test_workflow_and_configuration_of_the_working_directory_are_taken_first(calls, tmp_path, capsys):
    Path("workflow").mkdir()
    shutil.copy(ROOT / "workflow/Snakefile", "workflow")
    Path("config").mkdir()
    Path("config/config.yaml").write_text("frames: {known_poses: none}")
    (tmp_path / "photos/transforms.json").write_text("{}")
    make_scene(tmp_path / "photos", name="kitchen")
    assert "--snakefile" not in calls[0] and "results/mine/kitchen/scene.html" in calls[0]
    assert ": 3 pictures, " in capsys.readouterr().err


@pytest.mark.parametrize("place", ["Snakefile", "workflow/Snakefile"])
def test_the_project_of_another_workflow_is_left_alone(calls, tmp_path, place):
    for path, text in ((place, "rule all:\n"), ("config/config.yaml", "samples: [a]\n")):
        Path(path).parent.mkdir(exist_ok=True)
        Path(path).write_text(text)
    make_scene(tmp_path / "photos")
    assert calls[0][1:3] == ["--snakefile", str(ROOT / "workflow/Snakefile")]
    assert find_home(CONFIG) == ROOT / "config/config.yaml"
    assert make_command(Path("results/mine/photos/scene.html")).startswith("snakemake --snakefile ")


def test_a_hushed_run_tells_alarms_and_the_rest_only_if_it_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(command, "is_hushed", lambda: True)
    for status in (0, 1):
        said = r"print('said\nsplats: alarm: splats.psnr: low')"
        (tmp_path / "pretended.py").write_text(f"{said}; raise SystemExit({status})")
        ended = command.run_snakemake(["pretended"])
        assert ended == status == (told := capsys.readouterr().err).count("said")
        assert told.endswith("splats: alarm: splats.psnr: low\n")


def test_what_to_ask_is_told_and_asked_and_the_browser_opens(calls, tmp_path, monkeypatch, run_command):
    shown, asked = [], []
    monkeypatch.setattr("egosplat.viewing.command.show", lambda server, folder, options: shown.append(folder))
    monkeypatch.setattr("webbrowser.open", shown.append)
    run = ["run", str(tmp_path / "photos"), "--name", "home/hall"]
    (page := Path("results/home/hall/scene.html")).parent.mkdir(parents=True)
    page.touch()
    told = run_command(*run)[2]
    assert "egosplat catalog results/home/hall" in told and "egosplat view results/home/hall" in told
    assert " MB; " in told and "results/home/hall/scene.html; logs: logs/home/hall\n" in told
    monkeypatch.setattr(scenes.query, "callback", lambda folder, words, options: asked.extend(words))
    assert run_command(*run, "--cores", 2, "--words", "couch", "cup")[0] == 0 and asked == ["couch", "cup"]
    assert [run_command(*run, *one)[0] for one in (["--words"], ["couch"], ["--words", " "])] == [2, 2, 2]
    status, out, told = run_command(*run, "--quiet")
    assert (status, out, told.count("\n")) == (0, "", 1) and " is ready, " in told
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


def test_a_missing_splat_and_what_is_no_key_with_its_value_are_told_before_the_first_step(calls, tmp_path):
    told_of = {"frames.stride": "--set f", "frames.stride=2 a": "blanks", "splats.source=a.ply": "a.ply"}
    for pair, told in (told_of | {"frames.known_poses=Colmap": "'colmap'"}).items():
        with pytest.raises(UserError, match=told):
            make_scene(tmp_path / "photos", options=(pair,))
    assert not calls


@pytest.fixture
def put(tmp_path, monkeypatch):
    """``put(recording, options)``: the row of mine/kitchen in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def write(recording="a.mp4", options="", name="mine/kitchen"):
        path = tmp_path / recording
        path.touch()
        values = (*split_name(name), "plain", str(path), options)
        return put_row(defaults(), dict(zip(HEADER.split(), values, strict=True)))

    return write


def table(tmp_path) -> str:
    return (tmp_path / "config/scenes.local.tsv").read_text()


def test_a_row_is_read_beside_the_table_and_without_it(put, tmp_path):
    scene = put(options="frames.stride=3")
    assert scene.config["frames"]["stride"] == 3
    assert ("mine", "kitchen") in read_scenes(defaults())
    (tmp_path / "config/scenes.tsv").write_text(f"{HEADER}adt\tscene1\tadt\t-\tsynthetic.seed=1\n")
    assert [*read_scenes(defaults())] == [("adt", "scene1"), ("mine", "kitchen")]


def test_the_same_recording_keeps_one_row_with_the_last_keys_and_a_wrong_row_of_another_stays(put, tmp_path):
    put()
    wrong = ["old", "plain", "x.mp4", "frames.gone=1"]
    (tmp_path / "config/scenes.local.tsv").write_text(table(tmp_path) + "\t".join(["mine", *wrong]) + "\n")
    put("b.mp4", name="hall")
    put(options="frames.stride=3")
    rows = [line.split("\t")[1:] for line in table(tmp_path).splitlines()[1:]]
    assert rows == [
        wrong,
        ["hall", "plain", str(tmp_path / "b.mp4"), ""],
        ["kitchen", "plain", str(tmp_path / "a.mp4"), "frames.stride=3"],
    ]


def test_runs_that_begin_at_once_keep_the_rows_of_all(put, monkeypatch):
    put("a line\u2028.mp4")
    read = command.read_user_text
    monkeypatch.setattr(command, "read_user_text", lambda path: (read(path), time.sleep(0.1))[0])
    list(ThreadPoolExecutor().map(lambda name: put(name=name), ("a", "b")))
    assert {scene for _, scene in read_scenes(defaults())} >= {"a", "b", "kitchen"}


def test_another_recording_of_the_name_is_refused_unless_the_first_is_gone(put, tmp_path, monkeypatch):
    put()
    before = table(tmp_path)
    with pytest.raises(UserError, match=r"mine/kitchen: .*a\.mp4.*--name mine/kitchen2"):
        put("other.mp4")
    assert table(tmp_path) == before
    (tmp_path / "a.mp4").rename(tmp_path / "moved.mp4")
    assert put("moved.mp4").recording == tmp_path / "moved.mp4"
    assert table(tmp_path).count("kitchen") == 1
    # Of a row in the tracked table the name is never free.
    monkeypatch.setenv("HOME", str(tmp_path))
    for name, there in (("scenes.local", "~/moved.mp4"), ("scenes.local", "-"), ("scenes", "gone.mp4")):
        (tmp_path / f"config/{name}.tsv").write_text(f"{HEADER}mine\tkitchen\tplain\t{there}\t\n")
        with pytest.raises(UserError, match=rf"config/{name}\.tsv .* {there};"):
            put("other.mp4")


@pytest.mark.parametrize(
    "name, options, said",
    [
        *((name, "", "--name") for name in ("Mine/kitchen", "benchmark/k", "variants/k", "a/b/c", "mine/")),
        *((name, "", "--name") for name in ("mine/my kitchen", "../../kitchen")),
        ("k" * 101, "", "scene"),
        ("kitchen", "frames.strid=3", "frames.strid"),
        ("kitchen", "frames.stride=no", "frames.stride"),
    ],
)
def test_wrong_names_and_keys_are_named_and_write_nothing(put, tmp_path, name, options, said):
    with pytest.raises(UserError, match=said):
        put(name=name, options=options)
    assert not (tmp_path / "config").exists()
