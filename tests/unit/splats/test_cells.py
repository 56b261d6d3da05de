"""Gaussians of cells: no one is lost or doubled, corrections come from the cell of the camera, and all are one scene."""

from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import FITTED, POSES, SCHEMAS, TRAINED
from egosplat.errors import UserError
from egosplat.gaussians.initialization import SH_C0, seen
from egosplat.splats import cells, stage
from tests.support.gaussian_scene import CAMERA

KEYS = {"masking": "none", "iterations": 40, "max_gaussians": 60, "evaluate_every": 20, "sh_degree": 1}
MOST = 1.7976931348623157e308
LEFT = {"limits": [[-MOST, -MOST], [MOST, 0.05]], "margin": [0.1, 0.25], "frames": [0, 1, 2, 3, 5, 6, 7]}
RIGHT = {"limits": [[-MOST, 0.05], [MOST, MOST]], "margin": [0.1, 0.25], "frames": [3, 5, 6, 7, 8]}
"""Cells along x, the second axis of the ground; cameras are at -0.4, -0.3, ... 0.4; 4 is held out."""


@pytest.fixture
def folder(scene, survey_that_keeps) -> Path:
    made = scene(up=np.array([0.0, -1.0, 0.0]))
    survey_that_keeps(made, [*range(9)], static=True, cells=[LEFT, RIGHT])
    return made


def run(folder: Path, name: str = "splats.zarr", **more: object):
    """The verified artifact."""
    flags = {key: more.pop(key) for key in ("chunk", "gather") if key in more}
    paths = folder / "frames.zarr", folder / "poses.zarr", folder / name
    stage.run(*paths, stage.SplatsOptions(**KEYS | more), survey_path=folder / "survey.json", **flags)
    return verify(folder / name, SCHEMAS)


def gathered(folder: Path, **keys: object):
    """The scene, and the artifacts of its cells."""
    parts = [run(folder, f"splats.{number}.chunk", chunk=number, **keys) for number in (1, 2)]
    return run(folder, gather=[part.path for part in parts], **keys), *parts


def test_each_gaussian_of_a_cell_is_in_the_scene_once_and_none_of_a_neighbor(folder, survey_that_keeps):
    keys = {"iterations": 300, "max_gaussians": 200}
    splats, *parts = gathered(folder, **keys)
    own = [part.read("means") for part in parts]
    own = [own[0][own[0][:, 0] < 0.05], own[1][own[1][:, 0] >= 0.05]]
    assert all(5 < len(one) < part.shape("means")[0] for one, part in zip(own, parts, strict=True))
    assert splats.read("means").tolist() == np.concatenate(own).tolist()
    assert splats.facts["views"] == {"training": 8, "held out": 1} and splats.facts["iteration"] == 300
    whole = run(folder, "whole.zarr", **keys)
    assert splats.read("held_out/psnr")[0] > whole.read("held_out/psnr")[0] - 1.0
    survey_that_keeps(folder, [*range(9)], static=True)
    assert run(folder, "one.zarr", **keys).digest == whole.digest


def test_corrections_are_those_of_the_cell_that_holds_the_camera_and_cells_agree_on_what_they_share(folder):
    splats, *parts = gathered(folder, refine_poses="on", compensate_exposure="on")
    assert splats.read("corrections/source").tolist() == [TRAINED] * 4 + [FITTED] + [TRAINED] * 4
    shift, gain = (
        [one.read(f"corrections/{name}") for one in (splats, *parts)] for name in ("shift", "gain")
    )
    shared = [3, 5, 6, 7]
    apart, dim = (shift[1] - shift[2])[shared].mean(axis=0), np.log(gain[1] / gain[2])[shared].mean(axis=0)
    assert min(abs(apart[0]), *abs(dim)) > 1e-5
    np.testing.assert_allclose(shift[0][:5], shift[1][:5] - apart / 2, atol=1e-9)
    np.testing.assert_allclose(shift[0][5:], shift[2][5:] + apart / 2, atol=1e-9)
    np.testing.assert_allclose(np.log(gain[0][5:] / gain[2][5:]), np.tile(dim / 2, (4, 1)), atol=1e-9)
    # What a cell renders times its gain stays.
    own = parts[1].read("means")[:, 0] >= 0.05
    before, after = parts[1].read("sh")[own], splats.read("sh")[-own.sum() :]
    before[:, 0] += 0.5 / SH_C0
    after[:, 0] += 0.5 / SH_C0
    np.testing.assert_allclose(after, before * np.exp(-dim / 2), atol=1e-5)


def test_chunks_need_cells_and_one_that_is_lost_or_of_another_cut_is_named(folder, survey_that_keeps):
    _, first, second = (part.path for part in gathered(folder))
    for flags in ({"gather": [first]}, {"chunk": 3}):
        with pytest.raises(
            UserError, match="the survey has 2 cells; give --chunk of one, or --gather of all"
        ):
            run(folder, "other.zarr", **flags)
    with pytest.raises(UserError, match="splats.2.chunk: is not cell 1, or by other options"):
        run(folder, gather=[second, first])
    survey_that_keeps(folder, [*range(9)], static=True, cells=[LEFT, RIGHT | {"margin": [0.1, 0.26]}])
    with pytest.raises(UserError, match="splats.1.chunk: is not cell 1"):
        run(folder, gather=[first, second])


def test_few_points_beyond_the_wider_cell_are_taken(folder, capsys):
    poses = open_artifact(folder / "poses.zarr", POSES)
    (_, cell), _ = cells.read_cells(folder / "survey.json", poses)
    xyz, cameras = poses.read("points/xyz"), poses.read("camera_to_world")[cell.frames]
    visible, near = seen(xyz, CAMERA, cameras, near_plane=0.1), cell.holds(xyz, wider=True)
    run(folder, "splats.2.chunk", chunk=2, max_points=20)
    assert (visible & ~near).sum() > 4
    assert f"{(visible & near).sum() + 4} of 40 points are visible" in capsys.readouterr().err
