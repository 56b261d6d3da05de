"""Work on frames by chunks: what jobs of chunks give is gathered whole and in order, or not at all."""

from dataclasses import replace

import pytest
import torch

from egosplat.artifacts.checkpoint import Work
from egosplat.artifacts.provenance import begin
from egosplat.errors import UserError
from egosplat.pipeline.chunks import split_frames

FRAMES = 7


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr("egosplat.pipeline.chunks.CHUNK_FRAMES", 3)


@pytest.fixture
def made():
    return begin("tiles", {}, "real")


def squares(work: Work, did: list[int] | None = None) -> list | None:
    """The square of each odd frame."""

    def do(frames):
        for frame in frames:
            if did is not None:
                did.append(frame)
            yield torch.tensor(frame**2)

    return work.results(
        lambda chunks: [frame for chunk in chunks for frame in chunk if frame % 2], do, "squaring"
    )


@pytest.fixture
def files(tmp_path, made):
    """The results of all chunks."""
    found = [tmp_path / f"tiles.{number}.chunk" for number in (1, 2, 3)]
    for number, path in enumerate(found, 1):
        assert squares(Work(path, made, FRAMES, number)) is None
    return found


@pytest.mark.parametrize(
    "frames, chunks", [(0, []), (3, [range(3)]), (7, [range(3), range(3, 6), range(6, 7)])]
)
def test_each_frame_is_in_one_chunk(frames, chunks):
    assert split_frames(frames) == chunks


def test_chunks_give_what_one_job_gives_and_no_work_is_done_twice(tmp_path, made, files):
    did: list[int] = []
    gathered = Work(tmp_path / "tiles.zarr", made, FRAMES, gather=files)
    whole = squares(Work(tmp_path / "tiles.zarr", made, FRAMES))
    assert squares(gathered, did) == whole == [1, 9, 25] and did == []
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in files}


def test_the_cost_of_chunks_is_part_of_the_whole(tmp_path, made, files):
    work = Work(tmp_path / "tiles.zarr", made, FRAMES, gather=files)
    squares(work)
    jobs = [{**cost, "cpu_s": 100.0, "peak_memory_mb": 1e6} for cost in work.costs]
    told = replace(made, gathered=jobs).record()
    assert told["cpu_s"] >= 300 and told["peak_memory_mb"] == 1e6 and "gathered" not in told


@pytest.mark.parametrize("few", [(0,), (0, 2), (1, 0, 2), (0, 0, 1), (0, 1, 2, 2)])
def test_missing_chunks_and_another_order_are_errors(tmp_path, made, files, few):
    with pytest.raises(UserError, match="--gather"):
        squares(Work(tmp_path / "tiles.zarr", made, FRAMES, gather=[files[place] for place in few]))


def test_a_chunk_beyond_the_end_is_an_error(tmp_path, made):
    with pytest.raises(UserError, match="--chunk 4"):
        Work(tmp_path / "tiles.4.chunk", made, FRAMES, 4)


@pytest.mark.parametrize("how", ["absent", "damaged", "other options"])
def test_a_chunk_that_cannot_be_used_is_named(tmp_path, made, files, how):
    if how == "absent":
        files[1].unlink()
    elif how == "damaged":
        files[1].write_bytes(files[1].read_bytes()[:-1])
    else:
        squares(Work(files[1], replace(made, options={"set": "other"}), FRAMES, 2))
    with pytest.raises(UserError, match=r"tiles\.2\.chunk"):
        squares(Work(tmp_path / "tiles.zarr", made, FRAMES, gather=files))


def test_a_killed_job_of_a_chunk_resumes(tmp_path, made, monkeypatch):
    monkeypatch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)
    monkeypatch.setattr("egosplat.pipeline.chunks.CHUNK_FRAMES", 6)
    path, did = tmp_path / "tiles.1.chunk", []

    def killed(frames):
        yield torch.tensor(frames[0] ** 2)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Work(path, made, FRAMES, 1).results(lambda _: [1, 3, 5], killed, "squaring")
    assert not path.exists()
    assert squares(Work(path, made, FRAMES, 1), did) is None and did == [3, 5]
    assert path.exists() and len(list(tmp_path.iterdir())) == 1
