"""The local table of scenes: one row for each recording, and no recording in place of another."""

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import defaults
from egosplat.pipeline.scenes import read_scenes
from egosplat.run.command import put_row, split_name

COLUMNS = ("dataset", "scene", "format", "recording", "options")
HEAD = "\t".join(COLUMNS) + "\n"


@pytest.fixture
def put(tmp_path, monkeypatch):
    """``put(recording, options)``: the row of mine/kitchen in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def write(recording="a.mp4", options="", name="mine/kitchen"):
        path = tmp_path / recording
        path.touch()
        values = (*split_name(name), "plain", str(path), options)
        return put_row(defaults(), dict(zip(COLUMNS, values, strict=True)))

    return write


def table(tmp_path) -> str:
    return (tmp_path / "config/scenes.local.tsv").read_text()


def test_a_row_is_read_beside_the_table_and_without_it(put, tmp_path):
    scene = put(options="frames.stride=3")
    assert scene.config["frames"]["stride"] == 3
    assert ("mine", "kitchen") in read_scenes(defaults())
    (tmp_path / "config/scenes.tsv").write_text(f"{HEAD}adt\tscene1\tadt\t-\tsynthetic.seed=1\n")
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


def test_another_recording_of_the_name_is_refused_unless_the_first_is_gone(put, tmp_path):
    put()
    before = table(tmp_path)
    with pytest.raises(UserError, match=r"mine/kitchen: .*a\.mp4.*--name mine/kitchen2"):
        put("other.mp4")
    assert table(tmp_path) == before
    (tmp_path / "a.mp4").rename(tmp_path / "moved.mp4")
    assert put("moved.mp4").recording == tmp_path / "moved.mp4"
    assert table(tmp_path).count("kitchen") == 1
    # Of a row in the tracked table the name is never free.
    (tmp_path / "config/scenes.tsv").write_text(f"{HEAD}mine\tkitchen\tplain\tgone.mp4\t\n")
    with pytest.raises(UserError, match=r"config/scenes\.tsv"):
        put("moved.mp4")


@pytest.mark.parametrize(
    "name, options, said",
    [
        *((name, "", "--name") for name in ("Mine/kitchen", "benchmark/kitchen", "a/b/c", "mine/")),
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
