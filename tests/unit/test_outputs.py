"""An output replaces only an artifact of its kind: no other file is lost through a link or a mistyped path."""

import errno
import re
from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.integrity import ArtifactError
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.files import atomic_directory, atomic_file, scratch_directory

TINY = Schema("tiny", 1, {})
OTHER = Schema("other", 1, {"a": Field("int64 n", "-", "numbers")})


def write(path: Path, schema: Schema = TINY) -> None:
    with create(path, schema, begin("frames", {}, "real")) as artifact:
        for name in schema.fields:
            artifact.put(name, np.arange(3))


@pytest.fixture
def photos(tmp_path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "1.jpg").write_bytes(b"a photograph")
    return folder


def test_only_an_artifact_of_its_kind_is_replaced(tmp_path, photos):
    with pytest.raises(ArtifactError, match="photos: .*--output") as caught:
        write(photos)
    assert "rm " not in str(caught.value), "what is not egosplat's is not to be removed"
    with pytest.raises(ArtifactError, match="1.jpg"):
        write(photos / "1.jpg")
    assert (photos / "1.jpg").read_bytes() == b"a photograph"
    write(tmp_path / "a.zarr", OTHER)
    with pytest.raises(ArtifactError, match="a.zarr: .*'other'"):
        write(tmp_path / "a.zarr")
    write(tmp_path / "a.zarr", OTHER)


def test_a_damaged_artifact_and_an_empty_folder_are_replaced(tmp_path):
    write(tmp_path / "a.zarr")
    metadata = tmp_path / "a.zarr/zarr.json"
    metadata.write_text(metadata.read_text()[:-20])
    (tmp_path / "b.zarr").mkdir()
    for name in ("a.zarr", "b.zarr"):
        write(tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zarr", "b.zarr"]


@pytest.mark.parametrize("target", ["photos", "photos/1.jpg", "nowhere"])
def test_a_link_is_replaced_and_what_it_points_to_stays(tmp_path, photos, target):
    link = tmp_path / "new.zarr"
    link.symlink_to(tmp_path / target)
    write(link)
    assert link.is_dir() and not link.is_symlink()
    assert (photos / "1.jpg").read_bytes() == b"a photograph"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.zarr", "photos"]


@pytest.mark.parametrize("path", ["", ".", "..", "/", "photos/.."])
@pytest.mark.parametrize("made", [atomic_directory, atomic_file])
def test_a_path_without_a_name_is_rejected(folder, tmp_path, made, path):
    with pytest.raises(UserError, match=f"{re.escape(str(Path(path)))}: "), made(Path(path)):
        pytest.fail("it began")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("made", [atomic_directory, atomic_file])
def test_an_error_of_a_full_disk_names_what_was_to_be_made_and_one_of_reading_its_own_file(tmp_path, made):
    """The system names no file where bytes are written, or a hidden one."""
    for filename in (None, "hidden.tmp"):
        with pytest.raises(OSError, match="No space") as caught, made(tmp_path / "new.zarr"):
            raise OSError(errno.ENOSPC, "No space left on device", filename)
        assert caught.value.filename == str(tmp_path / "new.zarr")
    with pytest.raises(FileNotFoundError) as caught, made(tmp_path / "new.zarr"):
        (tmp_path / "absent").read_bytes()
    assert caught.value.filename == str(tmp_path / "absent")
    assert not list(tmp_path.iterdir())


def test_scratch_folders_of_the_dead_are_swept_those_of_the_living_and_links_stay(tmp_path, photos):
    (tmp_path / "scratch-dead").mkdir()
    (tmp_path / "scratch-dead/file").touch()
    (link := tmp_path / "scratch-link").symlink_to(photos)
    with scratch_directory("scratch-", tmp_path) as living, scratch_directory("scratch-", tmp_path) as mine:
        assert {*tmp_path.iterdir()} == {photos, link, living, mine}
    assert {*tmp_path.iterdir()} == {photos, link} and (photos / "1.jpg").exists()
