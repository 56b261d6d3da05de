"""Views at another size than the frames."""

import numpy as np
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.gaussians.training_views import read_views


def test_views_at_half_the_size_keep_their_content(scene):
    valid, masked = np.ones((32, 32), bool), np.zeros((6, 32, 32), bool)
    valid[0, 0], masked[2, 5, 7] = False, True
    folder = scene(valid=valid, masked=masked)
    artifacts = [open_artifact(folder / f"{each.name}.zarr", each) for each in (FRAMES, POSES)]
    views = read_views(*artifacts, np.arange(6) >= 1, torch.device("cpu"), resolution=16)
    assert views.frame.tolist() == [1, 2, 3, 4, 5] and views.pictures.shape == (5, 16, 16, 3)
    assert (views.camera.fx, views.camera.cx, views.camera.width) == (15.0, 8.0, 16)
    # A pixel of which a part lies outside the lens circle does not count, and one of which a part is masked is masked.
    assert float(views.valid[0, 0]) == 0.0 and float(views.valid.sum()) == 255.0
    assert np.argwhere(views.transient.numpy()).tolist() == [[1, 2, 3]]
    assert float(views.weight(1).sum()) == 254.0 and torch.equal(views.weight(0), views.valid)
    none = read_views(*artifacts, np.zeros(6, bool), torch.device("cpu"), resolution=16)
    assert none.pictures.shape[0] == 0
