"""Commands that write one file replace what is there only under their own name, or with ``--overwrite``."""

import errno
import fcntl
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.files import (
    atomic_directory,
    atomic_file,
    check_new_folder,
    check_output,
    check_writable,
    expand_home,
    read_json,
    read_user_text,
)
from egosplat.pipeline.stages import FILES, STAGES
from egosplat_rivals.tables import stage as tables_stage


def stage_words(stage: str) -> list[str]:
    """All inputs of a stage as flags."""
    paths = STAGES[stage].inputs + STAGES[stage].optional
    return [word for name in paths for word in (f"--{name.replace('_', '-')}", f"{{folder}}/{name}")]


COMMANDS = {
    "query": ("query.png", ["{folder}", "cup"]),
    "export": ("scene.ply", ["{folder}"]),
    "movie": ("query.webp", ["{folder}", "cup"]),
    "page": ("scene.html", ["{folder}"]),
    "story": ("story.html", ["{folder}/metrics.json", "--title", "x"]),
    **{stage: (STAGES[stage].output, stage_words(stage)) for stage in FILES},
}
"""Own name of the file that a command writes, and its arguments but --output; the inputs are empty folders or none."""


def linked(path: Path) -> None:
    target = path.with_name("elsewhere")
    target.write_text("notes")
    path.symlink_to(target)


NO_FILE: dict[str, Callable[[Path], object]] = {
    "a folder": lambda path: path.mkdir(),
    "a pipe": os.mkfifo,
    "a socket": lambda path: os.mknod(path, stat.S_IFSOCK | 0o600),
    "a link to a file": linked,
    "a link to nothing": lambda path: path.symlink_to("nothing"),
    "a link to a device": lambda path: path.symlink_to("/dev/null"),
}
"""Things that may have the name of an output; none is ever replaced."""


REFUSED = [(errno.ENOSPC, "Make room"), (errno.EDQUOT, "Make room"), (errno.EACCES, "make it writable")]
"""Numbers of errors of writing, and what is advised."""


def call(run_command, command: str, folder: Path, *words: object) -> tuple[int, str]:
    scene = folder.with_name(f"{folder.name}_scene")
    for stage in ("frames", "poses", "features", "instances", "splats", "language"):
        (scene / f"{stage}.zarr").mkdir(parents=True, exist_ok=True)
    given = [word.format(folder=scene) for word in COMMANDS[command][1]]
    status, _, err = run_command(command.replace("_", "-"), *given, *words)
    return status, err


def everything(folder: Path) -> dict[str, object]:
    """Kind, times and content of all that is below a folder."""
    found = {str(path): (path.lstat(), path.is_file() and path.read_bytes()) for path in folder.rglob("*")}
    return {name: (*status[:2], status.st_mtime_ns, content) for name, (status, content) in found.items()}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_another_name_stays_unless_overwrite_is_given(run_command, tmp_path, command):
    """Told before anything is read: the scene's artifacts are empty folders. A name with another suffix is refused."""
    suffix = Path(COMMANDS[command][0]).suffix
    output, other = tmp_path / f"mine{suffix}", tmp_path / "x.jpg"
    output.write_text("notes")
    before = everything(tmp_path)
    status, err = call(run_command, command, tmp_path, "--output", output)
    assert status == 2 and f"{output}: is there already" in err and "--overwrite" in err
    status, err = call(run_command, command, tmp_path, "--output", output, "--overwrite")
    assert status == 2 and str(output) not in err, "it complains of the scene"
    status, err = call(run_command, command, tmp_path, "--output", other, "--overwrite")
    assert status == 2 and f"{other}: " in err and suffix[1:] in err
    assert everything(tmp_path) == before


@pytest.mark.parametrize("name", ["x", "x.png.bak", "x.gz", ".png", "x.", "..", "."])
def test_names_without_the_suffix(tmp_path, name):
    with pytest.raises(UserError, match="--output"):
        check_output(tmp_path / name, "query.png", overwrite=True)


@pytest.mark.parametrize("target", NO_FILE)
@pytest.mark.parametrize("name", ["query.png", "x.png"])
def test_what_is_no_file_is_never_replaced(tmp_path, target, name):
    NO_FILE[target](tmp_path / name)
    before = everything(tmp_path)
    with pytest.raises(UserError, match=f"{name}: .*--output"):
        check_output(tmp_path / name, "query.png", overwrite=True)
    assert everything(tmp_path) == before


@pytest.mark.parametrize("name", ["query.png", "x.png", "X.PNG", "new/folder/x.png"])
def test_the_check_leaves_nothing_behind(tmp_path, name):
    check_output(tmp_path / name, "query.png", overwrite=False)
    check_writable([tmp_path / "logs/deeper"])
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    check_writable([tmp_path / "file/adt"])  # Snakemake says what is wrong with it


def output(folder: Path) -> None:
    check_output(folder / "query.png", "query.png", overwrite=True)


@pytest.mark.parametrize("check", [output, lambda folder: check_writable([folder / "results"])])
@pytest.mark.parametrize("number, advice", REFUSED)
def test_an_unwritable_folder_is_named_with_the_reason(tmp_path, monkeypatch, check, number, advice):
    def refuse(**_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", refuse)
    with pytest.raises(UserError, match=rf"{tmp_path}: {os.strerror(number)}\. .*{advice}") as caught:
        check(tmp_path)
    assert ("another --output" in str(caught.value)) == (check == output and number == errno.EACCES)


@pytest.mark.parametrize("write", [atomic_file, atomic_directory])
def test_no_stage_replaces_a_pipe_or_a_device(tmp_path, write):
    """Not even as the superuser, who may."""
    pipe = tmp_path / "pipe.zarr"
    os.mkfifo(pipe)
    for special in (pipe, Path("/dev/null")):
        before = special.stat()
        with pytest.raises(UserError, match="no regular file or folder"), write(special):
            pass
        assert special.stat() == before and list(tmp_path.iterdir()) == [pipe]


@pytest.mark.parametrize("target", [*NO_FILE, "a file"])
def test_a_new_folder_replaces_nothing(tmp_path, target):
    place = tmp_path / "place"
    NO_FILE.get(target, Path.touch)(place)
    with pytest.raises(UserError, match="is there already"):
        check_new_folder(place)
    assert os.path.lexists(place)


@pytest.mark.parametrize("check", [check_new_folder, lambda to: check_output(to, "x.png", overwrite=True)])
def test_a_place_below_a_file_or_device_is_named(tmp_path, check):
    (tmp_path / "file").touch()
    for above in (tmp_path / "file", Path("/dev/null")):
        with pytest.raises(UserError, match=f"{above} is no folder"):
            check(above / "sub" / "x.png")


def test_the_tables_replace_their_own_files(tmp_path):
    """Six files of the names that the command gives them, and nothing else in the folder."""
    (tmp_path / "notes.csv").write_text("notes")
    tables_stage.run([], tmp_path, pictures=[])
    before = everything(tmp_path)
    tables_stage.run([], tmp_path, pictures=[])
    after = everything(tmp_path)
    same = {name for name in before if before[name] == after[name]}
    assert same == {str(tmp_path / "notes.csv")} and before.keys() == after.keys() and len(before) == 7
    assert all(before[name][-1] == after[name][-1] for name in before)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda path: path.write_bytes("preset: draft".encode("utf-16")), "UTF-8"),
        (lambda path: path.write_bytes("# caf\u00e9".encode("latin-1")), "UTF-8"),
        (os.mkfifo, "is a pipe"),
        (Path.mkdir, ""),
        (lambda path: path.symlink_to(path), ""),
    ],
)
def test_what_is_no_text_is_named_and_no_pipe_is_waited_for(tmp_path, make, said):
    make(tmp_path / "a.yaml")
    with pytest.raises(UserError, match=f"a.yaml: .*{said}"):
        read_user_text(tmp_path / "a.yaml")


def test_a_mark_of_byte_order_is_no_part_of_a_text_and_nobody_has_a_home(tmp_path):
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}\r\n')
    assert read_user_text(tmp_path / "a.json") == '{"a": 1}\r\n'
    assert read_json(tmp_path / "a.json") == {"a": 1}
    assert expand_home("~nobody-of-this-name/x") == Path("~nobody-of-this-name/x")


@pytest.mark.parametrize("number", [errno.EBADF, errno.ENOSYS])
def test_a_file_system_may_lock_only_what_is_open_for_writing_or_nothing(tmp_path, monkeypatch, number):
    def flock(handle: int, _: int) -> None:
        writes = os.path.isdir(handle) or fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_RDWR
        if number == errno.ENOSYS or not writes:
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    (other := tmp_path / ".one.json.12345678.tmp").touch()
    with atomic_directory(tmp_path / "one.zarr"), atomic_file(tmp_path / "one.json"):
        assert other.exists() == (number == errno.ENOSYS), "it may be of a running writer"


def test_what_is_written_is_on_the_disk_before_it_has_its_name(monkeypatch, tmp_path):
    """Else a power failure may leave empty files under the name of a whole artifact."""
    flushed = set()

    def flush(handle: int) -> None:
        assert not any(name.exists() and name.stat().st_ino not in flushed for name in names)
        flushed.add(os.fstat(handle).st_ino)

    names = (tmp_path / "one.zarr", tmp_path / "one.json")
    monkeypatch.setattr(os, "fsync", flush)
    with atomic_directory(names[0]) as scratch:
        (scratch / "array").mkdir()
        (scratch / "array/0").write_text("values")
    with atomic_file(names[1]) as scratch:
        scratch.write_text("{}")
    assert {path.stat().st_ino for path in tmp_path.rglob("*")} <= flushed
