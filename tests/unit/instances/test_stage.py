"""Stage instances merges the masks of a small scene, renders them, resumes, and reports user errors."""

from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import SCHEMAS, SPLATS
from egosplat.errors import UserError
from egosplat.instances import stage
from egosplat.instances.lifted_masks import lift
from egosplat.pipeline.stages import run_stage
from tests.support.scenes import put
from tests.unit.instances.conftest import COLORS, DISTANCE, FRAMES, RIGHT, SIZE, marked, options


def run(folder, name="instances.zarr", **changes):
    """The verified artifact."""
    paths = (folder / f"{kind}.zarr" for kind in ("frames", "poses", "segments"))
    stage.run(*paths, folder / name, options(**changes))
    return verify(folder / name, SCHEMAS)


def agreement(found, truth, chosen=slice(None)) -> float:
    """Share of the chosen pixels of the whole things that name their square, whichever number it has."""
    shown = found.read("labels")[:, 1]
    return max((shown == names)[chosen].mean() for names in (truth, 1 - truth))


def test_each_square_is_one_instance_in_every_frame(scene, truth):
    """Frames without masks, among them a held-out one, show the merged instances, and Gaussians name the one of their square."""
    found = run(scene())
    assert found.read("instances/level").tolist() == [1, 1]
    assert found.read("instances/masks").tolist() == [5, 5]
    assert (found.read("labels")[:, 0] == -1).all() and agreement(found, truth) > 0.95
    assert set(found.provenance["inputs"]) == {"frames.zarr", "poses.zarr", "segments.zarr"}
    (x, _, z), instance = found.read("gaussians/xyz").T, found.read("gaussians/instance")[:, 1]
    on_wall = (np.abs(z - DISTANCE) < 0.2) & (np.abs(x) > 0.1) & (np.abs(x) < 1.0) & (instance >= 0)
    left, right = (instance[on_wall & side] for side in (x < 0, x > 0))
    assert len(left) > 50 and len(right) > 50
    assert np.bincount(left).argmax() != np.bincount(right).argmax()


def test_masks_are_merged_with_refined_poses(scene, monkeypatch):
    seen, train, folder = [], stage.train_geometry, scene()
    monkeypatch.setattr(stage, "train_geometry", lambda *all_: seen.append(train(*all_)) or seen[-1])
    given = verify(folder / "poses.zarr", SCHEMAS).read("camera_to_world")
    found = run(folder, refine_poses="on", compensate_exposure="on")
    views, cameras = seen[0].views, seen[0].camera_to_world
    np.testing.assert_array_equal(views.camera_to_world, cameras[views.frame])
    assert np.abs(cameras - given)[views.frame].max() > 1e-4
    assert found.read("instances/level").tolist() == [1, 1]


def test_the_source_tracks_passes_segments_through(scene):
    folder = scene()
    found = run(folder, source="tracks")
    segments = verify(folder / "segments.zarr", SCHEMAS)
    assert np.array_equal(found.read("labels"), segments.read("labels"))
    assert found.shape("gaussians/xyz") == (0, 3)
    moving = np.arange(FRAMES) == 2
    found = run(scene(**{"instances/moving": moving}), "moving.zarr", source="tracks")
    assert np.array_equal(found.read("instances/moving"), moving)


def test_a_broken_track_is_repaired(scene, truth):
    """The masks of two tracks that swap their squares in the middle are put together right."""
    labels = np.full((FRAMES, 2, SIZE, SIZE), -1, np.int32)
    labels[:, 1] = np.concatenate([truth[: FRAMES // 2], 1 - truth[FRAMES // 2 :]])
    folder = scene(labels=labels, **{"instances/level": np.ones(2, np.int8)})
    found = run(folder, source="masks")
    assert found.shape("instances/level") == (2,)
    assert agreement(found, truth) > 0.95 and (labels[:, 1] == truth).mean() < 0.6


def test_what_moves_is_drawn_over_the_instances_and_takes_no_part_in_merging(scene, truth, monkeypatch):
    """A thing that hides another place of the wall in each frame but the last is one track."""
    looked = {}

    def watched(geometry, segments, shown, select):
        lifted = lift(geometry, segments, shown, select)
        looked.update({frame: select(segments.row("labels", frame)) for frame in lifted.row.tolist()})
        return lifted

    monkeypatch.setattr("egosplat.instances.scene.lift", watched)
    labels, hidden = marked(truth), np.zeros((FRAMES, SIZE, SIZE), bool)
    for frame in range(FRAMES - 1):
        hidden[frame, 4 * frame : 4 * frame + 8, 10:30] = True
    labels[:, 1][hidden] = -1
    labels[:, 0][hidden] = FRAMES
    level, moving = np.ones(FRAMES + 1, np.int8), np.arange(FRAMES + 1) == FRAMES
    level[FRAMES] = 0
    rgb = COLORS[truth]
    rgb[hidden] = (40, 200, 40)
    changes = {"rgb": rgb, "labels": labels, "instances/level": level, "instances/moving": moving}
    found = run(scene(**changes))
    assert list(looked) == [0, 2, 4, 6, 8], "frames that show nothing but what moves have no vote"
    for frame, (voting, unseen) in looked.items():
        assert np.array_equal(unseen, hidden[frame]) and (voting[:, unseen] == -1).all()
    assert found.read("instances/level").tolist() == [1, 1, 0]
    assert found.read("instances/moving").tolist() == [False, False, True]
    assert found.read("instances/masks").tolist() == [5, 5, FRAMES - 1]
    shown = found.read("labels")
    assert np.array_equal(shown[:, 0] == 2, hidden) and (shown[:, 0][~hidden] == -1).all()
    assert (shown[:, 1][hidden] == -1).all()
    assert agreement(found, truth, ~hidden) > 0.95
    assert found.read("gaussians/instance").max() == 1


def test_a_track_that_stands_still_is_merged_like_any_mask(scene, truth):
    """The right square is a track in every frame, as if the transient network took it for something that moves."""
    labels = marked(truth)
    labels[:, 1][truth == RIGHT] = FRAMES
    level, moving = np.ones(FRAMES + 1, np.int8), np.arange(FRAMES + 1) == FRAMES
    times = np.arange(FRAMES, dtype=np.int64) * 10**9
    changes = {"labels": labels, "instances/level": level, "instances/moving": moving, "timestamp_ns": times}
    found = run(scene(**changes))
    assert found.facts["standing_tracks"] == 1
    assert found.read("instances/moving").tolist() == [False, False]
    assert found.read("instances/masks").tolist() == [5, 5], "only frames with masks of their own vote"
    assert agreement(found, truth) > 0.95


def test_a_killed_run_resumes_to_the_same_result(scene, monkeypatch):
    folder = scene()
    whole = run(folder)
    monkeypatch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)
    monkeypatch.setattr(stage, "find_scene", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        run(folder, "killed.zarr")
    assert Checkpoint(folder / "killed.zarr", "", 0.0).file.exists()
    monkeypatch.undo()
    again = run(folder, "killed.zarr")
    for name in again.schema.fields:
        assert np.array_equal(again.read(name), whole.read(name)), name
    assert not Checkpoint(folder / "killed.zarr", "", 0.0).file.exists()


def test_frames_without_masks_are_reported(scene):
    labels = np.full((FRAMES, 2, SIZE, SIZE), -1, np.int32)
    folder = scene(labels=labels, **{"instances/level": np.zeros(0, np.int8)})
    with pytest.raises(UserError, match=r"segments.zarr.*instances.source"):
        run(folder)


def test_segments_of_other_frames_are_rejected(scene, tmp_path_factory):
    folder = scene()
    (folder / "segments.zarr").rename(folder / "kept")
    scene(rgb=np.zeros((FRAMES, SIZE, SIZE, 3), np.uint8))
    (folder / "kept").rename(folder / "other.zarr")
    paths = [folder / f"{name}.zarr" for name in ("frames", "poses", "other", "x")]
    with pytest.raises(UserError, match="was made from another"):
        stage.run(*paths, options())


def test_pixels_that_a_frame_leaves_out_neither_vote_nor_get_a_label(scene, truth):
    """Half of the frames hide their left half, where their masks, if they counted, would be one with the right square's."""
    hidden = np.zeros((FRAMES, SIZE, SIZE), bool)
    hidden[::4, :, : SIZE // 2] = True
    found = run(scene(labels=marked(np.where(hidden, RIGHT, truth)), masked=hidden))
    assert found.read("instances/level").tolist() == [1, 1]
    assert (found.read("labels")[:, 1][hidden] == -1).all() and agreement(found, truth, ~hidden) > 0.95
    assert found.facts["pixels_without_instance"] < 0.05


def test_masks_are_merged_on_given_gaussians_with_their_poses(scene, truth, monkeypatch):
    """They are neither trained nor changed, and no key of training matters. Other Gaussians of the scene may be asked with the instances."""
    folder, found, seen = scene(), {}, []
    wall = np.stack(np.meshgrid(np.linspace(-1.5, 1.5, 60), np.linspace(-1, 1, 40)), -1).reshape(-1, 2)
    means = np.column_stack([wall, np.full(len(wall), DISTANCE)]).astype(np.float32)
    moved = verify(folder / "poses.zarr", SCHEMAS).read("camera_to_world").copy()
    moved[:, 0, 3] += 1e-3
    splats = {
        "means": means,
        "quats": np.tile(np.float32([1, 0, 0, 0]), (len(means), 1)),
        "log_scales": np.full((len(means), 3), np.log(0.025), np.float32),
        "logit_opacities": np.full(len(means), 4, np.float32),
        "sh": np.zeros((len(means), 1, 3), np.float32),
        "corrections/camera_to_world": moved,
        "corrections/source": np.ones(FRAMES, np.int8),
        "corrections/shift": np.zeros((FRAMES, 3)),
        "corrections/turn": np.zeros(FRAMES),
        "corrections/gain": np.ones((FRAMES, 3)),
    }
    put(folder, "splats", splats, made_from=["frames", "poses"])
    given = stage.given_geometry
    monkeypatch.setattr(stage, "given_geometry", lambda *all_: seen.append(given(*all_)) or seen[-1])
    paths = [folder / f"{name}.zarr" for name in ("frames", "poses", "segments", "instances")]
    for iterations in (1, 20):
        stage.run(*paths, options(iterations=iterations), splats_path=folder / "splats.zarr")
        found[iterations] = verify(folder / "instances.zarr", SCHEMAS)
    assert found[1].digest == found[20].digest
    assert np.array_equal(found[20].read("gaussians/xyz"), means) and agreement(found[20], truth) > 0.95
    made = found[20].provenance
    assert made["options"]["splats"] == open_artifact(folder / "splats.zarr", SPLATS).digest
    assert "splats.zarr" not in made["inputs"] and lineage([found[20]]).lost == ()
    np.testing.assert_array_equal(seen[0].camera_to_world, moved)
    np.testing.assert_array_equal(seen[0].views.camera_to_world, moved[seen[0].views.frame])


def test_the_page_has_a_view_from_above_if_masks_were_merged(scene):
    folder = scene({"segmenter": "sam2"})
    paths = {kind: folder / f"{kind}.zarr" for kind in ("frames", "poses", "instances")}
    pages = []
    for source in ("masks", "tracks"):
        run(folder, source=source)
        run_stage("instances_sheet", None, **paths, output=folder / "page.png", title="adt/scene1")
        pages.append(cv2.imread(str(folder / "page.png")))
    merged, tracks = pages
    assert merged.shape[1] > tracks.shape[1] and merged.shape[0] == tracks.shape[0]
    right = merged[:, tracks.shape[1] :].reshape(-1, 3)
    # Two squares of the wall, in two colors.
    assert len({tuple(color) for color in right if color.max() - color.min() > 120}) >= 2
