"""The pages of a recording and of its Gaussians are drawn from whatever its artifacts hold."""

import numpy as np
import pytest

from egosplat.geometry import Camera, ground_axes
from egosplat.report.sheets.sheet import palette, tint
from tests.support.scenes import camera_facts, put_scene, sideways

SIDE = 24


def recording(folder, frames: int, evaluation: int, points: int, instances: int, registered: int):
    rng, poses = np.random.default_rng(0), sideways(np.arange(frames))
    poses[registered:] = np.nan
    arrays = {
        "rgb": rng.integers(0, 255, (frames, SIDE, SIDE, 3), dtype=np.uint8),
        "train": np.arange(frames) >= evaluation,
        "frame": np.arange(evaluation),
        "annotated": np.arange(evaluation) % 2 == 0,
        "instance_map": rng.integers(-1, instances, (evaluation, SIDE, SIDE), dtype=np.int32),
        "camera_to_world": poses,
        "registered": np.arange(frames) < registered,
        "up": np.array([0.0, 1.0, 0.0]),
        "points/xyz": rng.normal(size=(points, 3)),
    }
    facts = camera_facts(Camera(SIDE, SIDE, 20.0, 20.0, SIDE / 2, SIDE / 2))
    facts["instances"] = [{"category": f"thing {i}"} for i in range(instances)]
    return put_scene(folder, ("frames", "annotations", "poses"), arrays, facts)


def gaussians(folder, held_out: int, records: int, corrections: int):
    rng, frames = np.random.default_rng(0), 8

    def pictures(count: int) -> np.ndarray:
        return rng.integers(0, 255, (count, 20, 30, 3), dtype=np.uint8)

    arrays = {
        "rgb": pictures(frames),
        "valid": np.repeat(np.arange(20)[:, None] >= 4, 30, axis=1),
        "means": np.zeros((5, 3), np.float32),
        "curve/iteration": np.arange(records) * 10 + 10,
        "curve/loss": 0.3 / np.arange(1.0, records + 1),
        "curve/gaussians": np.arange(records) + 100,
        "history/iteration": np.array([5, 10]),
        "history/psnr": np.full(2, 20.0 if held_out else np.nan),
        "history/ssim": np.full(2, 0.8 if held_out else np.nan),
        "held_out/frame": np.arange(held_out),
        "held_out/psnr": np.full(held_out, 21.5),
        "held_out/ssim": np.full(held_out, 0.85),
        "held_out/render": pictures(held_out),
    }
    facts = camera_facts(Camera(30, 20, 20.0, 20.0, 15.0, 10.0))
    facts |= {"iteration": 10, "views": {"training": 3}, "training_s": 1.25, "rasterizer": "reference"}
    if corrections:
        facts |= {"scene_depth": 2.0, "up": [0.0, -1.0, 0.0]}
        poses = sideways(np.arange(frames))
        poses[-1] = np.nan
        arrays |= {
            "held_out/psnr_given": np.full(held_out, 20.5),
            "held_out/ssim_given": np.full(held_out, 0.80),
            "held_out/render_given": pictures(held_out),
            "corrections/camera_to_world": poses,
            "corrections/source": np.array([1, 1, 2, 1, 1, 3, 1, 0], np.int8),
            "corrections/shift": rng.normal(size=(frames, 3)) * (corrections - 1),
            "corrections/turn": rng.uniform(size=frames),
            "corrections/gain": np.exp(rng.normal(size=(frames, 3))),
        }
    return put_scene(folder, ["frames", "poses", "splats"], arrays, facts, origin="real")


PAGES = {
    "usual": ("contact_sheet", recording, (20, 5, 500, 7, 20)),
    "few": ("contact_sheet", recording, (3, 1, 1, 1, 2)),
    "almost nothing": ("contact_sheet", recording, (2, 0, 0, 0, 1)),
    "usual Gaussians": ("splats_sheet", gaussians, (8, 300, 0)),
    "few, corrected": ("splats_sheet", gaussians, (1, 1, 2)),
    "nothing held out, corrections of 0": ("splats_sheet", gaussians, (0, 3, 1)),
}


@pytest.mark.parametrize("stage, make, counts", PAGES.values(), ids=PAGES)
def test_the_page_is_written_as_one_picture(tmp_path, draw, stage, make, counts):
    picture = draw(stage, make(tmp_path, *counts))
    assert picture.shape[1] > (1000 if stage == "contact_sheet" else 700) and picture.std() > 10


@pytest.mark.parametrize("up", [[0, 1, 0], [0, 0, 1], [1, 0, 0], [0.6, 0.8, 0], [3**-0.5] * 3])
def test_ground_axes_are_orthonormal_and_seen_from_above(up):
    right, ahead = ground_axes(np.asarray(up, float))
    frame = np.stack([right, ahead, up])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-8)
    assert np.linalg.det(frame) == pytest.approx(1.0)  # right x ahead = up: not mirrored


def test_a_tint_tells_instances_apart_and_leaves_the_rest():
    picture = np.full((2, 2, 3), 100, np.uint8)
    tinted = tint(picture, np.array([[-1, 0], [1, 0]], np.int32), palette(2))
    assert (tinted[0, 0] == 100).all()
    assert (tinted[0, 1] == tinted[1, 1]).all() and (tinted[0, 1] != tinted[1, 0]).any()
    assert (tint(picture, np.full((2, 2), -1), palette(0)) == 100).all()
