"""The page of instances draws frames, and the Gaussians from above where there are some."""

import cv2
import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.instances import stage
from egosplat.report import instances_sheet
from tests.unit.instances.conftest import FRAMES, options


def draw(folder, name, source):
    """Pixels of the page of a source."""
    inputs = [folder / f"{kind}.zarr" for kind in ("frames", "poses", "segments")]
    stage.run(*inputs, folder / f"{name}.zarr", options(source=source))
    page = folder / f"{name}.png"
    instances_sheet.run(*inputs[:2], folder / f"{name}.zarr", page, title="adt/scene1")
    return cv2.imread(str(page))


def test_the_view_from_above_is_there_if_masks_were_merged(scene):
    folder = scene({"segmenter": "sam2"})
    merged, tracks = draw(folder, "merged", "masks"), draw(folder, "tracks", "tracks")
    assert merged.shape[1] > tracks.shape[1]
    right = merged[:, tracks.shape[1] :]
    # Two squares of the wall, in two colours.
    assert len({tuple(color) for color in right.reshape(-1, 3) if color.max() - color.min() > 120}) >= 2


def test_instances_of_other_frames_are_rejected(scene):
    folder = scene()
    inputs = [folder / f"{kind}.zarr" for kind in ("frames", "poses", "segments")]
    stage.run(*inputs, folder / "instances.zarr", options(source="tracks"))
    (folder / "frames.zarr").rename(folder / "before")
    other = scene(train=np.ones(FRAMES, bool))
    with pytest.raises(UserError, match="was made from another"):
        instances_sheet.run(
            other / "frames.zarr", inputs[1], folder / "instances.zarr", folder / "x.png", title="t"
        )
