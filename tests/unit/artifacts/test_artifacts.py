"""Artifacts are whole or absent, and damage is named."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts import writer
from egosplat.artifacts.integrity import ArtifactError, seal
from egosplat.artifacts.lineage import check_tree
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.schemas import POSES, SCHEMAS
from egosplat.artifacts.writer import create

TINY = Schema(
    "tiny",
    2,
    {
        "rows": Field("uint8 frame height 3", "-", "rows", by_row=True),
        "flags": Field("bool frame", "-", "flags"),
        "points/xyz": Field("float64 point 3", "m", "points"),
        "feature": Field("float32 view 2", "-", "many short rows", by_row=3),
    },
)
VIEWS = 8
"""Three chunks in two shards; the last one of both is not full."""


@pytest.fixture(autouse=True)
def known(monkeypatch):
    monkeypatch.setitem(SCHEMAS, "tiny", TINY)
    monkeypatch.setattr(writer, "CHUNKS_IN_SHARD", 2)


def made(inputs=None) -> Provenance:
    clocks = "2020-01-01", time.perf_counter(), 0.0
    return Provenance("tiny", {"k": 3}, "real", inputs or {}, {}, "c0de", {}, *clocks)


def write(path: Path, points: int = 5, inputs=None, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    rows = rng.integers(0, 255, (4, 6, 3), dtype=np.uint8)
    rows[1] = 0  # an all-zero chunk must be stored like any other
    values = {"flags": np.zeros(4, bool), "points/xyz": rng.normal(size=(points, 3))}
    values["feature"] = rng.normal(size=(VIEWS, 2)).astype(np.float32)
    with create(path, TINY, made(inputs)) as artifact:
        artifact.allocate("rows", rows.shape)
        for index in (2, 1, 0, 3):
            artifact.put_row("rows", index, rows[index])
        for name, array in values.items():
            artifact.put(name, array)
        artifact.facts = {"answer": 42}
    return values | {"rows": rows}


def leftovers(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


@pytest.mark.parametrize("points", [0, 1, 5])
def test_written_arrays_and_facts_are_read_back(tmp_path, points):
    values = write(tmp_path / "a.zarr", points)
    artifact = open_artifact(tmp_path / "a.zarr", TINY)
    for name, expected in values.items():
        found = artifact.read(name)
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(artifact.row("rows", 2), values["rows"][2])
    stored = json.loads((tmp_path / "a.zarr/zarr.json").read_text())["attributes"]["egosplat"]
    assert {*stored} == {"schema", "format_version", "digest", "provenance", "facts", "seal"}
    assert artifact.facts == {"answer": 42} and artifact.provenance["options"] == {"k": 3}
    assert artifact.provenance["wall_s"] >= 0 and artifact.provenance["peak_memory_mb"] > 0
    assert artifact.provenance["cpu_s"] >= 0 and "core" in artifact.provenance["machine"]
    assert "peak_gpu_memory_mb" in artifact.provenance and "started_cpu" not in artifact.provenance
    assert leftovers(tmp_path) == ["a.zarr"]


def test_an_error_leaves_nothing_and_keeps_the_old_artifact(tmp_path):
    path = tmp_path / "a.zarr"
    with pytest.raises(RuntimeError, match="stop"), create(path, TINY, made()) as artifact:
        artifact.put("flags", np.zeros(4, bool))
        raise RuntimeError("stop")
    assert leftovers(tmp_path) == []
    values = write(path)
    with pytest.raises(RuntimeError), create(path, TINY, made()):
        raise RuntimeError
    np.testing.assert_array_equal(verify(path, SCHEMAS).read("rows"), values["rows"])
    write(path, seed=3)
    assert verify(path, SCHEMAS) and leftovers(tmp_path) == ["a.zarr"]


def fill(artifact, rows=range(4), **facts):
    """Write all but some rows."""
    artifact.allocate("rows", (4, 6, 3))
    for index in rows:
        artifact.put_row("rows", index, np.zeros((6, 3), np.uint8))
    artifact.put("flags", np.zeros(4, bool))
    artifact.put("points/xyz", np.zeros((0, 3)))
    artifact.put("feature", np.zeros((0, 2), np.float32))
    artifact.facts = facts


@pytest.mark.parametrize(
    "fault, message",
    [
        (lambda a: a.put("flags", np.zeros(4, np.uint8)), "uint8.* given, bool"),
        (lambda a: a.put("flags", np.zeros((4, 1), bool)), "has 2 axes, not 1"),
        (lambda a: (fill(a), a.allocate("rows", (5, 6, 3))), "size 5 along axis 'frame'"),
        (lambda a: (fill(a), a.put_row("rows", 0, np.zeros((6, 3)))), "float64"),
        (lambda a: None, "never written: feature, flags, points/xyz, rows"),
        (lambda a: fill(a, rows=(0, 1, 3)), "rows lacks 1 rows"),
        (lambda a: a.put_row("feature", 0, np.zeros(2, np.float32)), "feature: is not written by row"),
        (lambda a: fill(a, bad=float("nan")), "JSON"),
    ],
)
def test_a_writer_that_breaks_its_schema_is_stopped(tmp_path, fault, message):
    with pytest.raises(ValueError, match=message), create(tmp_path / "a.zarr", TINY, made()) as artifact:
        fault(artifact)
    assert leftovers(tmp_path) == []


def edit(file: Path, old: str, new: str) -> None:
    file.write_text(file.read_text().replace(old, new))


def flip(file: Path, position: int = -9) -> None:
    content = bytearray(file.read_bytes())
    content[position] ^= 1
    file.write_bytes(content)


def test_a_flipped_byte_is_named_when_it_is_read(tmp_path):
    write(tmp_path / "a.zarr")
    flip(tmp_path / "a.zarr/rows/c.1.0.0", 5)
    artifact = open_artifact(tmp_path / "a.zarr", TINY)
    artifact.row("rows", 1)
    reads = (artifact.row, "rows", 2), (artifact.read, "rows"), (verify, artifact.path, SCHEMAS)
    for read, *given in reads:
        with pytest.raises(ArtifactError, match=r"a\.zarr: array 'rows', chunk 2 .*rm -r"):
            read(*given)


def test_an_artifact_may_lack_an_optional_array_and_no_other(tmp_path):
    numbers, path = Field("int64 n", "-", "numbers"), tmp_path / "tiny.zarr"
    schema = Schema("tiny", 1, {"a": numbers, "b": replace(numbers, optional=True)})
    with create(path, schema, made()) as artifact:
        artifact.put("a", np.arange(3))
    found = verify(path, {"tiny": schema})
    assert found.arrays == ["a"] and found.has("a") and not found.has("b")
    (path / "a/c.0").write_bytes(b"damaged")
    with pytest.raises(ArtifactError, match="'a' cannot be read"):
        verify(path, {"tiny": schema})
    with pytest.raises(ValueError, match="never written: a"), create(path, schema, made()) as artifact:
        artifact.put("b", np.arange(3))
    with create(path, schema, made()) as artifact:
        artifact.put("a", np.arange(3))
        artifact.put("b", np.arange(3))
    assert verify(path, {"tiny": schema}).arrays == ["a", "b"]


@pytest.mark.parametrize("rows, chunks, files", [(VIEWS, 3, 2), (3, 1, 1), (2, 1, 1), (0, 0, 0)])
def test_a_chunk_holds_as_many_rows_as_declared_and_a_file_two_chunks(tmp_path, rows, chunks, files):
    schema = Schema("tiny", 2, {"feature": TINY.fields["feature"]})
    values = np.arange(2 * rows, dtype=np.float32).reshape(rows, 2)
    with create(tmp_path / "a.zarr", schema, made()) as artifact:
        artifact.put("feature", values)
    found = open_artifact(tmp_path / "a.zarr", schema)
    assert len([*found.chunks("feature")]) == chunks
    assert len([*(tmp_path / "a.zarr/feature").glob("c*")]) == files
    np.testing.assert_array_equal(found.read("feature"), values)


def test_a_reader_of_one_frame_reads_its_chunk_and_the_index_alone(tmp_path):
    rows, shard = write(tmp_path / "a.zarr")["rows"], tmp_path / "a.zarr/rows/c.0.0.0"
    artifact, whole = open_artifact(tmp_path / "a.zarr", TINY), shard.read_bytes()
    # By Zarr's specification, at the end: first byte and length of each of two chunks, and a checksum.
    first = np.frombuffer(whole[-36:-4], "<u8")[0]
    for content in (b"", whole[:3], whole[:-1], whole[1:], bytes(first) + whole[first:]):
        shard.write_bytes(content)
        with pytest.raises(ArtifactError, match="'rows', chunk 1 cannot be read"):
            artifact.row("rows", 1)
    np.testing.assert_array_equal(artifact.row("rows", 0), rows[0])


@pytest.mark.parametrize(
    "damage, message",
    [
        (lambda p: (p / "rows/c.0.0.0").unlink(), "'rows' lacks chunks"),
        (lambda p: (p / "feature/c.1.0").unlink(), "'feature' lacks chunks"),
        (lambda p: (p / "flags/zarr.json").unlink(), "array 'flags' is missing"),
        (lambda p: (p / "flags/zarr.json").write_text("{"), "array 'flags' is unreadable"),
        (lambda p: (p / "zarr.json").unlink(), "no readable Zarr group"),
        (lambda p: (p / "zarr.json").write_text("rubbish"), "no readable Zarr group"),
        (lambda p: edit(p / "zarr.json", "42", "43"), "attributes were"),
    ],
)
def test_damage_is_named_when_the_artifact_is_opened(tmp_path, damage, message):
    write(tmp_path / "a.zarr")
    damage(tmp_path / "a.zarr")
    with pytest.raises(ArtifactError, match=message):
        open_artifact(tmp_path / "a.zarr", TINY)


def test_the_digest_is_of_the_content_and_detects_damage_that_reading_misses(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        write(tmp_path / f"{name}.zarr", seed=seed)
    a, b, c = (open_artifact(tmp_path / f"{name}.zarr", TINY).digest for name in "abc")
    assert a == b != c
    (tmp_path / "a.zarr/.snakemake_timestamp").touch()
    assert verify(tmp_path / "a.zarr", SCHEMAS), "a file of Snakemake is no damage"
    chunk = "rows/c.1.0.0"
    (tmp_path / "a.zarr" / chunk).write_bytes((tmp_path / "c.zarr" / chunk).read_bytes())
    open_artifact(tmp_path / "a.zarr", TINY).read("rows")  # a well-formed chunk of another artifact
    with pytest.raises(ArtifactError, match="digest"):
        verify(tmp_path / "a.zarr", SCHEMAS)


@pytest.mark.parametrize(
    "name, schema, message",
    [
        ("none.zarr", TINY, "none.zarr"),
        ("results/a/b/frames.zarr", TINY, "snakemake .*--cores 2 results/a/b/frames.zarr"),
        ("a.zarr", POSES, "'tiny', not 'poses'"),
        ("a.zarr", replace(TINY, version=1), r"version 2, .* 1\. Update"),
        ("a.zarr", replace(TINY, version=3), "format version 2, this is version 3. Rebuild it"),
    ],
)
def test_what_is_not_the_artifact_gets_a_message_of_its_own(folder, name, schema, message):
    write(Path("a.zarr"))
    with pytest.raises(ArtifactError, match=message):
        open_artifact(Path(name), schema)


@pytest.mark.parametrize(
    "content", [{"1.jpg": b"a photograph"}, {"zarr.json": b"{}"}, {"zarr.json": b"no JSON"}, {}]
)
def test_a_user_s_own_folder_is_never_advised_to_be_removed(tmp_path, content):
    """A recording given in the place of an artifact, even one below a folder called results."""
    folder = tmp_path / "results" / "walk"
    folder.mkdir(parents=True)
    for name, data in content.items():
        (folder / name).write_bytes(data)
    for path in (folder, folder / "1.jpg"):
        with pytest.raises(ArtifactError, match="artifact") as caught:
            open_artifact(path, TINY)
        assert "rm " not in str(caught.value) and "snakemake" not in str(caught.value)


KILLED = """
import signal, sys, time, numpy as np
from pathlib import Path
from egosplat.artifacts.schemas import FRAMES
from egosplat.artifacts.writer import create
from egosplat.artifacts.provenance import begin
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell runs in the background
with create(Path(sys.argv[1]), FRAMES, begin("frames", {}, "real")) as artifact:
    artifact.allocate("rgb", (3, 8, 8, 3))
    artifact.put_row("rgb", 0, np.zeros((8, 8, 3), np.uint8))
    print("writing", flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_killed_writer_leaves_no_artifact_and_the_next_removes_its_scratch(tmp_path, how):
    path = tmp_path / "a.zarr"
    words = [sys.executable, "-c", KILLED, path]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdout.readline() == b"writing\n"
    write(path)  # the living writer's folder is left alone
    assert any(name.endswith(".tmp") for name in leftovers(tmp_path))
    os.kill(process.pid, how)
    assert process.wait(timeout=120) != 0
    assert verify(path, SCHEMAS)
    write(path)
    assert leftovers(tmp_path) == ["a.zarr"]


def test_too_many_open_files_are_no_damage(tmp_path):
    """Else a whole artifact would be thrown away for what the system refused."""
    write(tmp_path / "a.zarr")
    artifact = open_artifact(tmp_path / "a.zarr", TINY)
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, before[1]))
    try:
        with pytest.raises(OSError, match="Too many open files"):
            open_artifact(tmp_path / "a.zarr", TINY)
        with pytest.raises(OSError, match="Too many open files"):
            artifact.read("rows")
        (problem,) = check_tree(tmp_path / "a.zarr", lambda _: None).values()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert "Too many open files" in problem and "damaged" not in problem
    assert artifact.read("rows").any()


def test_check_distinguishes_valid_damaged_and_outdated_artifacts(tmp_path):
    write(tmp_path / "a.zarr")
    digest = open_artifact(tmp_path / "a.zarr", TINY).digest
    write(tmp_path / "b.zarr", inputs={"a.zarr": digest})
    lines: list[str] = []
    assert not any(check_tree(tmp_path, lines.append).values()) and len(lines) == 2
    write(tmp_path / "a.zarr", seed=9)
    problems = [*check_tree(tmp_path, lines.append).values()]
    assert problems[0] == "" and "made from another a.zarr" in problems[1]
    flip(tmp_path / "a.zarr/rows/c.0.0.0", 5)
    assert "chunk 1" in check_tree(tmp_path / "a.zarr", lines.append)[tmp_path / "a.zarr"]


@pytest.mark.parametrize("part", ["format_version", "digest", "facts", "provenance"])
def test_an_attribute_that_is_missing_is_named(tmp_path, part):
    write(tmp_path / "a.zarr")
    metadata = tmp_path / "a.zarr/zarr.json"
    document = json.loads(metadata.read_text())
    own = document["attributes"]["egosplat"]
    del own[part]
    own["seal"] = seal(own)
    metadata.write_text(json.dumps(document))
    with pytest.raises(ArtifactError, match=f"a.zarr: its attributes lack '{part}'"):
        getattr(open_artifact(tmp_path / "a.zarr", TINY), part)
