"""Commands that write one file under a name that the user gives replace nothing that they did not write."""

import json
import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat import cli
from egosplat.drawing import plt, save_figure
from egosplat.errors import UserError
from egosplat.export.ply import PLY, write_ply
from egosplat.output_files import check_output, output_file, picture_kind, stage_json_kind, write_text_file
from egosplat.pipeline.stages import PAGES, STAGES
from egosplat.query.answers import QUERY_PICTURE
from egosplat.report.tables import stage as tables_stage

DOCUMENTS = ("metrics", "method_metrics", "survey")
"""Stages that write JSON; the others but the sheets write artifacts."""


def stage_words(stage: str) -> list[str]:
    """All inputs of a stage as flags."""
    paths = STAGES[stage].inputs + tuple(STAGES[stage].optional)
    return [word for name in paths for word in (f"--{name.replace('_', '-')}", f"{{folder}}/{name}")]


COMMANDS = {
    "query": (".png", ["{folder}", "cup"]),
    "export": (".ply", ["{folder}"]),
    **{stage: (".json", stage_words(stage)) for stage in DOCUMENTS},
    **{stage: (Path(STAGES[stage].output).suffix, stage_words(stage)) for stage in PAGES},
}
"""Suffix of the file that a command writes, and its arguments but --output; the inputs are empty folders or none."""


def foreign_picture(path: Path) -> None:
    Image.new("RGB", (4, 4)).save(path, format="PNG")


def picture_of(command: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        save_figure(plt.figure(), path.with_suffix(".png"), picture_kind(command))
        path.with_suffix(".png").rename(path)

    return make


def foreign_ply(path: Path) -> None:
    path.write_bytes(b"ply\nformat ascii 1.0\ncomment a scan\nelement vertex 0\nend_header\n")


def json_of_others(path: Path) -> None:
    path.write_text('{"format_version": 1, "name": "mine"}')


def json_of_a_stage(path: Path) -> None:
    path.write_text('{"format_version": 1, "provenance": {"stage": "other"}}')


def unix_socket(path: Path) -> None:
    os.mknod(path, stat.S_IFSOCK | 0o600)


def linked(make: Callable[[Path], object] | None) -> Callable[[Path], None]:
    def link(path: Path) -> None:
        target = path.with_name("elsewhere" + path.suffix)
        if make:
            make(target)
        path.symlink_to(target)

    return link


def folder_with_pictures(path: Path) -> None:
    path.mkdir()
    (path / "1.jpg").write_bytes(b"a photograph")


OWN_NAME = {
    "a picture from elsewhere": (foreign_picture, "was not written by"),
    "a picture of another command": (picture_of("egosplat other"), "was not written by"),
    "a picture of a command with a longer name": (picture_of("egosplat query-sheet"), "was not written by"),
    "a scan from elsewhere": (foreign_ply, "was not written by"),
    "JSON from elsewhere": (json_of_others, "was not written by"),
    "scores of another stage": (json_of_a_stage, "was not written by"),
    "JSON that is no object": (lambda path: path.write_text("[1]"), "was not written by"),
    "a text": (lambda path: path.write_text("notes"), "was not written by"),
    "a signature and no more": (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n"), "was not written by"),
    "bytes": (lambda path: path.write_bytes(b"\xff\xfe" * 4000), "was not written by"),
    "an empty folder": (lambda path: path.mkdir(), "is a folder"),
    "a folder of pictures": (folder_with_pictures, "is a folder"),
    "a pipe": (os.mkfifo, "is a device, pipe or socket"),
    "a socket": (unix_socket, "is a device, pipe or socket"),
    "a link to a file": (linked(foreign_picture), "is a link to"),
    "a link to a folder": (linked(folder_with_pictures), "is a link to"),
    "a link to nothing": (linked(None), "is a link to"),
    "a link to a device": (lambda path: path.symlink_to("/dev/null"), "is a link to /dev/null"),
}
"""Things that may be at a path with the right suffix, and the message for each."""

OTHER_NAMES = [
    "metrics.json",
    "frames.zarr",
    "x.jpg",
    "x",
    "x.png.bak",
    "x.gz",
    ".png",
    ".ply",
    "x.",
    "..",
    ".",
]
"""Names that end in no command's suffix or in another's."""


def call(monkeypatch, capfd, command: str, folder: Path, output: Path) -> tuple[int, str]:
    scene = folder.with_name(f"{folder.name}_scene")
    for stage in ("frames", "poses", "features", "splats", "language"):
        (scene / f"{stage}.zarr").mkdir(parents=True, exist_ok=True)
    words = [word.format(folder=scene) for word in COMMANDS[command][1]]
    monkeypatch.setattr(sys, "argv", ["egosplat", command.replace("_", "-"), *words, "--output", str(output)])
    try:
        cli.main()
    except SystemExit as end:
        return int(end.code or 0), capfd.readouterr().err
    return 0, capfd.readouterr().err


def everything(folder: Path) -> dict[str, object]:
    """Kind, times and content of all that is below a folder."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        content = path.read_bytes() if path.is_file() else None
        found[str(path)] = (status.st_mode, status.st_ino, status.st_mtime_ns, content)
    return found


@pytest.mark.parametrize("target", OWN_NAME)
@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_did_not_write_stays(monkeypatch, capfd, tmp_path, command, target):
    """Told before anything is read: the scene's artifacts are empty folders."""
    make, said = OWN_NAME[target]
    output = tmp_path / f"out{COMMANDS[command][0]}"
    make(output)
    before = everything(tmp_path)
    status, err = call(monkeypatch, capfd, command, tmp_path, output)
    assert status == 2 and str(output) in err and said in err and "Traceback" not in err
    assert everything(tmp_path) == before


@pytest.mark.parametrize("name", OTHER_NAMES)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_name_with_another_suffix_is_rejected(monkeypatch, capfd, tmp_path, command, name):
    """Whether something has that name or not."""
    suffix = COMMANDS[command][0]
    if Path(name).suffix == suffix:
        pytest.skip("it is this command's own")
    for exists in (False, True):
        if exists and not (tmp_path / name).exists():
            (tmp_path / name).write_text('{"format_version": 1}')
        before = everything(tmp_path)
        status, err = call(monkeypatch, capfd, command, tmp_path, tmp_path / name)
        assert status == 2 and f"writes {suffix} files; give --output a name" in err
        assert everything(tmp_path) == before


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_in_place_of_an_output_folder_is_reported(monkeypatch, capfd, tmp_path, command):
    (tmp_path / "file").write_bytes(b"a file")
    output = tmp_path / "file" / f"out{COMMANDS[command][0]}"
    status, err = call(monkeypatch, capfd, command, tmp_path, output)
    assert status == 2 and str(output) in err and (tmp_path / "file").read_bytes() == b"a file"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes device nodes")
def test_a_device_node_with_the_suffix_stays(tmp_path):
    output = tmp_path / "null.png"
    try:
        os.mknod(output, 0o20666, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("no device node may be made here")
    with pytest.raises(UserError, match="is a device"):
        check_output(output, QUERY_PICTURE)


@pytest.mark.parametrize("make", [None, lambda path: path.touch(), lambda path: picture(path)])
def test_empty_and_own_pictures_are_replaced(tmp_path, make):
    output = tmp_path / "OUT.PNG"
    if make:
        make(output)
    check_output(output, QUERY_PICTURE)
    picture(output)
    assert Image.open(output).info["Software"] == "egosplat query"


def picture(path: Path) -> None:
    save_figure(plt.figure(), path, QUERY_PICTURE)


def test_an_own_ply_is_replaced_one_from_elsewhere_is_not(tmp_path):
    columns = {name: np.zeros(2, np.float32) for name in "xyz"}
    write_ply(tmp_path / "x.ply", columns, "real")
    write_ply(tmp_path / "x.ply", columns, "synthetic")
    assert b"comment egosplat, origin synthetic" in (tmp_path / "x.ply").read_bytes()
    foreign_ply(tmp_path / "y.ply")
    with pytest.raises(UserError, match=r"y\.ply"):
        write_ply(tmp_path / "y.ply", columns, "real")


def test_the_check_is_made_again_at_writing(tmp_path):
    """A file that appears during minutes of work stays."""
    output = tmp_path / "out.ply"
    check_output(output, PLY)
    foreign_ply(output)
    with pytest.raises(UserError, match="is there already"), output_file(output, PLY):
        pytest.fail("it began")


FOLDERS = {
    "tables": ["adt_accuracy.csv", "adt_accuracy.md", "hoi4d.tex", "tables.html"],
    "tradeoff": ["tradeoff.json", "tradeoff.csv", "tradeoff.png", "tradeoff.html"],
}
"""Files that a command writes in the folder that the user names."""


@pytest.mark.parametrize("name", [name for names in FOLDERS.values() for name in names])
@pytest.mark.parametrize(
    "target", ["a text", "JSON from elsewhere", "a picture from elsewhere", "a folder of pictures"]
)
def test_a_folder_that_holds_files_of_others_is_rejected(monkeypatch, capfd, tmp_path, name, target):
    """Before any of the command's files is written."""
    command = next(command for command, names in FOLDERS.items() if name in names)
    points = '[{"settings": [], "metrics": [], "recipe": {"keys": {}, "command": ""}}]'
    words = ["--points", points] if command == "tradeoff" else []
    make, said = OWN_NAME[target]
    make(tmp_path / name)
    before = everything(tmp_path)
    monkeypatch.setattr(sys, "argv", ["egosplat", command, *words, "--output", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    err = capfd.readouterr().err
    assert end.value.code == 2 and str(tmp_path / name) in err and said in err
    assert everything(tmp_path) == before


def test_the_tables_replace_their_own_files(tmp_path):
    """Each of the sixteen kinds is recognized by its content."""
    tables_stage.run([], tmp_path, pictures=[])
    before = everything(tmp_path)
    tables_stage.run([], tmp_path, pictures=[])
    after = everything(tmp_path)
    assert before.keys() == after.keys() and len(before) == 16
    assert all(before[name] != after[name] and before[name][-1] == after[name][-1] for name in before)


@pytest.mark.parametrize("stage", DOCUMENTS)
def test_a_stage_replaces_its_own_json(tmp_path, stage):
    kind = stage_json_kind(stage)
    made = {"provenance": {"stage": stage}}
    for value in (1, 2):
        write_text_file(tmp_path / "x.json", json.dumps(made | {"value": value}), kind)
    assert json.loads((tmp_path / "x.json").read_text())["value"] == 2
