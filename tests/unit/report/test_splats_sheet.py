"""The page of a scene's Gaussians is drawn from whatever its artifacts hold."""

import numpy as np
import pytest

from egosplat.geometry import Camera
from tests.support.scenes import camera_facts, put_scene

HEIGHT, WIDTH = 20, 30


def scene(folder, held_out: int, records: int, corrections: int):
    rng, frames = np.random.default_rng(0), 8

    def pictures(count: int) -> np.ndarray:
        return rng.integers(0, 255, (count, HEIGHT, WIDTH, 3), dtype=np.uint8)

    arrays = {
        "rgb": pictures(frames),
        "valid": np.repeat(np.arange(HEIGHT)[:, None] >= 4, WIDTH, axis=1),
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
    facts = camera_facts(Camera(WIDTH, HEIGHT, 20.0, 20.0, 15.0, 10.0))
    facts |= {"iteration": 10, "views": {"training": 3}, "training_s": 1.25, "rasterizer": "reference"}
    if corrections:
        facts |= {"scene_depth": 2.0, "up": [0.0, -1.0, 0.0]}
        poses = np.tile(np.eye(4), (frames, 1, 1))
        poses[:, 0, 3] = np.arange(frames)
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
    return put_scene(folder, ["frames", "splats"], arrays, facts, origin="real")


@pytest.mark.parametrize(
    "held_out, records, corrections",
    [(8, 300, 0), (1, 1, 2), (0, 3, 1)],
    ids=["usual", "few, corrected", "nothing held out, corrections of 0"],
)
def test_the_page_is_written_as_one_picture(tmp_path, draw, held_out, records, corrections):
    picture = draw("splats_sheet", scene(tmp_path, held_out, records, corrections))
    assert picture.shape[1] > 700 and picture.std() > 10
