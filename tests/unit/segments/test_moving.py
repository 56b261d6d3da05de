"""Tracks of what moves beside masks of single frames: where they start, which labels win, resuming, the artifact."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint, Work
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SEGMENTS
from egosplat.compute import choose_compute
from egosplat.errors import UserError
from egosplat.models.sam2_loader import Sam2
from egosplat.segments import stage
from egosplat.segments.moving import add_tracks, track_moving
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.tracker import Tracker
from egosplat.segments.video import LabelMaps, Segmented, Track
from tests.support.scenes import put
from tests.unit.segments.conftest import FRAMES, HEIGHT, OPTIONS, VALID, WIDTH, video_of

OPTIONS = OPTIONS.change(key_frame_stride=2, max_instances=3)
TRAINING = np.array([0, 1, 3, 4])
PROMPTED = [0, 3]
pytestmark = pytest.mark.usefixtures("all_masks", "few_key_frames")


@pytest.fixture(scope="module")
def few_key_frames():
    """Key frames follow the stride in a video of a few frames, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("egosplat.segments.options._MIN_KEY_FRAMES", 1)
        yield


def probability(*frames: int) -> np.ndarray:
    """(F, H, W): everything moves in these frames, and nothing in the others."""
    found = np.zeros((FRAMES, HEIGHT, WIDTH), np.float16)
    found[list(frames)] = 1
    return found


def tracked(sam2, images, moves, asked=None, shown=VALID) -> Segmented:
    """What moves in the video, and, in ``asked``, the frames that are read."""
    video = video_of(images, asked, lambda _: shown)
    return track_moving(sam2, video, OPTIONS, moves.__getitem__, TRAINING)


def tracker(sam2, images, moves, options=OPTIONS) -> Tracker:
    return Tracker(sam2, video_of(images), options, moves.astype(np.float32).__getitem__, PROMPTED)


def labeled(found: Segmented) -> list[bool]:
    return [bool((found.labels[frame] >= 0).any()) for frame in range(FRAMES)]


NOT_FINITE = probability(0)
NOT_FINITE[0, :20] = np.nan


@pytest.mark.parametrize(
    ("moves", "shown"),
    [
        (probability(), VALID),
        (probability(1, 2, 4), VALID),
        (NOT_FINITE, np.arange(HEIGHT)[:, None] < np.full(WIDTH, 20)),
    ],
)
def test_what_does_not_move_is_not_tracked_and_no_frame_is_encoded(sam2, images, moves, shown):
    asked: list[int] = []
    found = tracked(sam2, images, moves, asked=asked, shown=shown)
    assert found.instances == [] and asked == [] and not any(labeled(found))


def test_tracks_start_where_something_moves_and_go_both_ways(sam2, images):
    asked: list[int] = []
    found = tracked(sam2, images, probability(2, 3, 4), asked=asked)
    assert found.instances and {(one.first_frame, one.moving) for one in found.instances} == {(3, True)}
    assert labeled(found) == [False, False, True, True, True]
    assert asked[:2] == [3, 4], "frames before the first track are read backwards only"
    assert set(asked[2:]) <= {0, 1, 2}


def test_a_track_is_lost_where_nothing_moves_and_found_again(sam2, images):
    """The mask of a frame in which it rests is neither labeled nor remembered."""
    found = tracker(sam2, images, probability(0, 1, 3, 4), OPTIONS).run()
    assert labeled(found) == [True, True, False, True, True]


@pytest.mark.parametrize(("elsewhere", "kept"), [(0.72, True), (0.6, False)])
def test_tracks_that_do_not_move_after_all_are_dropped(sam2, images, elsewhere, kept):
    """The mean of all training frames has to reach the threshold 0.7; it takes less to start. Frame 2 is none of them."""
    moves = probability(0)
    moves[0], moves[[1, 3, 4]], moves[2] = 0.65, elsewhere, 1 - elsewhere
    found = tracked(sam2, images, moves)
    assert bool(found.instances) == kept
    numbers = {number for frame in range(FRAMES) for number in np.unique(found.labels[frame])}
    assert numbers - {-1} == set(range(len(found.instances)))


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_mask_starts_a_track_by_the_mean_probability_inside_it(sam2, images, precision):
    """Six sevenths of the threshold are enough. Also in bfloat16, whose products would round the sums."""
    moves = probability()
    moves[0, :, : WIDTH // 2] = 0.75  # of the mask's size, 32 of 64 columns
    masks = torch.zeros(3, 64, 64, dtype=torch.bool)
    masks[0, :, :32], masks[1, :, 32:], masks[2, :, :48] = True, True, True
    of_precision = Sam2(sam2.video_predictor, choose_compute("cpu", precision))
    for threshold, expected in ((0.875, [0]), (0.58, [0, 2]), (0.6, [0]), (0.0, [0, 1, 2])):
        movers = tracker(of_precision, images, moves, OPTIONS.change(threshold=threshold))
        with of_precision.compute.inference():
            assert movers._may_move(masks, 0, 6 / 7).nonzero()[:, 0].tolist() == expected, threshold


def test_few_moving_pixels_are_searched(sam2, images):
    moves = probability()
    moves[0, 10:15, 14:21] = 1
    options = OPTIONS.change(points_per_side=16)
    area = tracker(sam2, images, moves, options)._moving(0) > 0.6
    assert options.min_area * area.numel() < area.sum() < 0.02 * area.numel()
    assert tracker(sam2, images, moves, options).run().prompted == [0]
    assert tracker(sam2, images, moves, options.change(min_area=0.02)).run().prompted == []


def both(sam2, images, moves, folder, asked, reads=None) -> Segmented:
    """Masks of single frames, and tracks of what moves; killed after a number of ``reads``."""
    video = video_of(images, asked, reads=reads)
    transient = SimpleNamespace(row=lambda _, frame: moves[frame])
    output, made = folder / "segments.zarr", begin("segments", {}, "real")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("egosplat.models.sam2_loader.load_sam2", lambda *_: sam2)
        patch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)
        patch.setattr("egosplat.segments.tracker._KEPT_PIXELS", 0)  # so that both directions read
        tracks = Checkpoint(output, "key", part="tracks")
        work = Work(output, made, FRAMES)
        return stage._segment_with_sam2(video, np.arange(FRAMES), TRAINING, transient, OPTIONS, work, tracks)


@pytest.fixture(scope="module")
def uninterrupted(sam2, images, all_masks, tmp_path_factory) -> tuple[Segmented, list[int]]:
    """What a run finds in which every frame moves, and the frames that it reads."""
    asked: list[int] = []
    return both(sam2, images, probability(*range(FRAMES)), tmp_path_factory.mktemp("whole"), asked), asked


@pytest.mark.parametrize("reads", [1, 2, 3, 5])
def test_a_killed_run_resumes_to_the_same_result(sam2, images, uninterrupted, tmp_path, reads):
    """The run is killed among the single frames, between both parts, or in either direction of tracking."""
    moves, (expected, asked) = probability(*range(FRAMES)), uninterrupted
    assert asked[:4] == [*PROMPTED, 0, 1] and len(asked) > reads, "the kill comes before the end"
    assert any(one.moving for one in expected.instances) and not expected.instances[0].moving

    with pytest.raises(KeyboardInterrupt):
        both(sam2, images, moves, tmp_path, [], reads)
    again: list[int] = []
    found = both(sam2, images, moves, tmp_path, again)
    assert again == asked[reads:], "finished frames are not read again"
    assert found.instances == expected.instances and found.prompted == expected.prompted
    for frame in range(FRAMES):
        assert np.array_equal(found.labels[frame], expected.labels[frame])


def maps(*frames: list[list[int]]) -> LabelMaps:
    """Labels of two levels in one row of pixels."""
    found = LabelMaps((len(frames), 2, 1, len(frames[0][0])))
    for frame, rows in enumerate(frames):
        found[frame] = np.array(rows, np.int32)[:, None]
    return found


def test_tracks_win_over_masks_and_masks_of_the_same_thing_go():
    nothing, masks = [-1] * 6, [Track(level, 0, 1, 1) for level in (0, 0, 1)]
    single = Segmented(maps([[0, 0, 0, 1, 1, 1], [2] * 6], [nothing] * 2), masks, [], [0])
    shown = maps([nothing, [-1, 0, 0, 0, -1, -1]], [nothing, [-1, -1, -1, -1, 0, 0]])
    found = add_tracks(single, Segmented(shown, [Track(1, 0, 0.5, 0.5, moving=True)], [], [0]))
    # Most of mask 0 is of the track and goes; a third of mask 1 and half of mask 2 are, and the rest stays.
    assert found.labels[0][:, 0].tolist() == [[-1, -1, -1, -1, 1, 1], [2, 3, 3, 3, 2, 2]]
    assert found.labels[1][:, 0].tolist() == [nothing, [-1, -1, -1, -1, 3, 3]]
    expected = [(0, False), (0, False), (1, False), (1, True)]
    assert [(one.level, one.moving) for one in found.instances] == expected and found.prompted == [0]


SIDE = 96


@pytest.fixture
def scene(tmp_path):
    """Frames in which a red square moves and a yellow one rests on a rough wall, and the probability that it does."""
    rgb = np.tile(np.random.default_rng(0).integers(90, 150, (SIDE, SIDE, 3), np.uint8), (4, 1, 1, 1))
    moves = np.zeros((4, SIDE, SIDE), np.float16)
    rgb[:, 60:90, 60:90] = (200, 200, 40)
    for frame in range(4):
        square = np.s_[frame, 10:40, 8 + 8 * frame : 38 + 8 * frame]
        rgb[square], moves[square] = (220, 30, 30), 0.9
    frames = put(tmp_path, "frames", {"rgb": rgb}, {"upright": True})
    transient = put(tmp_path, "transient", {"probability": moves}, made_from=["frames"])
    return frames, transient


def test_the_square_that_moves_is_tracked_and_the_still_one_is_not(scene, tmp_path):
    output = tmp_path / "segments.zarr"
    keys = {"key_frame_stride": 4, "threshold": 0.6, "min_frames": 2, "points_per_side": 8}
    stage.run(scene[0], output, SegmentsOptions(**keys), transient_path=scene[1])
    segments = open_artifact(output, SEGMENTS)
    labels, moving = segments.read("labels"), segments.read("instances/moving")
    tracks = np.append(moving, False)[labels].any(axis=1)
    for frame in range(4):
        assert tracks[frame, 25, 23 + 8 * frame], "the red square"
        assert not tracks[frame, 75, 75], "the yellow square"
    assert (labels[0, :, 75, 75] >= 0).any() and (labels[1:, :, 75, 75] == -1).all()
    assert 0 < moving.sum() < len(moving) and segments.facts["moving"] == moving.sum()
    assert {"frames.zarr", "transient.zarr"} == set(segments.provenance["inputs"])
    assert segments.facts["key_frames"] == [0] and "frames_per_instance" not in segments.facts


def test_a_frame_without_a_pose_is_no_key_frame(scene, tmp_path):
    registered = np.arange(4) % 2 == 1
    poses = put(tmp_path, "poses", {"registered": registered}, made_from=["frames"])
    keys = {"key_frame_stride": 2, "points_per_side": 4, "crops_per_side": 1, "track_moving": "never"}
    stage.run(scene[0], tmp_path / "segments.zarr", SegmentsOptions(**keys), poses_path=poses)
    segments = open_artifact(tmp_path / "segments.zarr", SEGMENTS)
    assert segments.facts["key_frames"] == [1] and "poses.zarr" in segments.provenance["inputs"]


def test_jobs_of_chunks_give_the_same_artifact(scene, tmp_path, monkeypatch):
    """They need not know what moves; the job that gathers their masks tracks it."""
    monkeypatch.setattr("egosplat.pipeline.chunks.CHUNK_FRAMES", 3)
    keys = {"key_frame_stride": 2, "threshold": 0.6, "min_frames": 2, "points_per_side": 4}
    options = SegmentsOptions(**keys, crops_per_side=1, track_moving="always")
    stage.run(scene[0], tmp_path / "segments.zarr", options, transient_path=scene[1])
    files = [tmp_path / f"segments.{number}.chunk" for number in (1, 2)]
    for number, file in enumerate(files, 1):
        stage.run(scene[0], file, options, chunk=number)
    stage.run(scene[0], tmp_path / "gathered.zarr", options, transient_path=scene[1], gather=files)
    whole = open_artifact(tmp_path / "segments.zarr", SEGMENTS)
    gathered = open_artifact(tmp_path / "gathered.zarr", SEGMENTS)
    assert gathered.digest == whole.digest and gathered.facts == whole.facts
    assert gathered.provenance["inputs"] == whole.provenance["inputs"] and whole.facts["key_frames"] == [0, 2]
    with pytest.raises(UserError, match=r"segments\.prompting"):
        stage.run(scene[0], files[0], options.change(prompting="initial_frame"), chunk=1)


def test_without_the_transient_network_nothing_is_tracked(scene, tmp_path):
    always = SegmentsOptions(track_moving="always")
    with pytest.raises(UserError, match=r"segments\.track_moving = always .* --transient"):
        stage.run(scene[0], tmp_path / "none.zarr", always)
    frames, none = open_artifact(scene[0], stage.FRAMES), {"track_moving": "never"}
    for keys in (none, {"prompting": "initial_frame"}, {"segmenter": "classical"}):
        assert stage._open_transient(scene[1], frames, SegmentsOptions(**keys)) is None
    assert stage._open_transient(None, frames, SegmentsOptions()) is None
    assert stage._open_transient(scene[1], frames, SegmentsOptions()) is not None
