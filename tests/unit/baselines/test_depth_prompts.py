"""Prompts by depth, as in GAGS: their density on a plane at known depths, and the masks that they give."""

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.artifacts.segments import SEGMENTS
from egosplat.baselines import depth_prompts_stage
from egosplat.baselines.depth_prompts_stage import (
    CELLS,
    PARTS,
    PromptsOptions,
    SplatViews,
    cell_ratios,
    draw_points,
    points_a_side,
)
from egosplat.errors import UserError
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.geometry import Camera
from egosplat.segments import stage
from egosplat.segments.options import MASK_FILTERS, MaskFilter, SegmentsOptions
from egosplat.segments.prompts import grid_points
from tests.support.scenes import camera_facts, put, put_scene

SIDE = 64
SETTINGS = RenderSettings(near_plane=0.1, background="black", antialiased=False, backend="auto")
CAMERA = Camera(SIDE, SIDE, 60.0, 60.0, SIDE / 2, SIDE / 2)
# Distance of each camera from the plane [m]; the last one sees only its left half, the one before it does not train.
DISTANCES = (1.0, 1.26, 2.1, 6.0, 3.0, 1.0)
HELD_OUT, HALF = 4, 5


def test_points_grow_with_the_ratio_from_1_to_20_a_side():
    ratios = np.array([0.9, 1.0, 1.24, 1.25, 2.0, 5.0, 6.0, np.nan])
    assert points_a_side(ratios).tolist() == [1, 4, 4, 5, 8, 20, 20, 1]
    assert points_a_side(np.array([1 - 1e-7, 1.25 - 1e-7, 1e9])).tolist() == [4, 5, 20]


def test_the_ratio_of_a_cell_is_that_of_means_where_there_is_something():
    depth, least = np.full((24, 32), 3.0), np.zeros((24, 32))
    depth[:3, :4], depth[0, 0] = 0.0, 2.0  # of the first cell, one pixel shows a surface
    least[1, 1], least[2, 2] = 1.0, 3.0
    least[3:6, :4] = 1.5
    found = cell_ratios(depth, least)
    assert found.shape == (CELLS, CELLS) and found[0, 0] == 1.0 and found[1, 0] == 2.0
    assert np.isnan(found).sum() == CELLS**2 - 2
    assert np.isnan(cell_ratios(np.zeros((24, 32)), least)).all()


def test_points_lie_in_their_cells_and_more_where_there_are_more_centers():
    sides = np.ones((CELLS, CELLS), np.int64)
    sides[2, 5] = 20
    centers = np.zeros((160, 320), bool)
    centers[40:42, 200:204] = True  # the first part of that cell, 8 centers
    found = draw_points(sides, centers, np.random.default_rng(0))
    assert found.shape == (400 + CELLS**2 - 1, 2) and found.min() > 0 and found.max() < 1
    column, row = (found * CELLS).astype(int).T
    numbers = np.bincount(row * CELLS + column, minlength=CELLS**2)
    assert np.array_equal(numbers, sides.ravel() ** 2)
    first = (found * CELLS * PARTS).astype(int).tolist().count([5 * PARTS, 2 * PARTS])
    # A chance of 9 / 108 against 1 / 108.
    assert 20 < first < 50
    assert draw_points(sides, np.zeros((37, 53), bool), np.random.default_rng(0)).shape == found.shape


def plane_of(z: float) -> Gaussians:
    """Opaque Gaussians on a square of 8 m at a depth [m]."""
    grid = np.linspace(-4.0, 4.0, 161)
    xyz = np.stack(np.meshgrid(grid, grid, [z]), axis=-1).reshape(-1, 3)
    rgb = np.zeros((len(xyz), 3), np.uint8)
    found = from_points(xyz, rgb, sh_degree=0, feature_channels=0, max_points=len(xyz), seed=0)
    found.logit_opacities.fill_(6.0)
    return found


def ratio_of(distance: float, cell: int) -> float:
    """Of a cell in the lower right in a view 6 m away: the distance over the mean of the least ones."""
    # Of the Gaussians in a pixel, the last one is at its outer corner.
    corner = np.arange(CELLS) + 1.0
    down = (corner + cell * CELLS - SIDE / 2) / CAMERA.fx * distance
    farthest = np.maximum(down[:, None], corner / CAMERA.fx * distance)
    least = np.full(farthest.shape, np.inf)
    for one in sorted(DISTANCES[:HELD_OUT], reverse=True):
        least[farthest < SIDE / 2 / CAMERA.fx * one] = one
    return distance / least.mean()


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    """A folder with a plane of opaque Gaussians and the cameras that look at it from their distances."""
    folder = tmp_path_factory.mktemp("plane")
    poses = np.tile(np.eye(4), (len(DISTANCES), 1, 1))
    poses[:, 2, 3] = [-one for one in DISTANCES]
    poses[HALF, 0, 3] = 4.0  # the plane ends in the middle
    valid = np.ones((SIDE, SIDE), bool)
    valid[: SIDE // CELLS] = False
    arrays = {
        "rgb": np.random.default_rng(0).integers(256, size=(len(DISTANCES), SIDE, SIDE, 3), dtype=np.uint8),
        "train": np.arange(len(DISTANCES)) != HELD_OUT,
        "valid": valid,
        "camera_to_world": poses,
        "intrinsics": CAMERA.matrix,
    }
    put_scene(folder, ["frames", "poses"], arrays, camera_facts(CAMERA), chained=True)
    parameters = {name: part.numpy() for name, part in plane_of(0.0).parameters().items()}
    options = {"near_plane": 0.1, "background": "black", "antialiased": False}
    put(folder, "splats", parameters, made_from=["frames", "poses"], options=options)
    return folder


def prompts_of(folder, name="prompts", **changes):
    inputs = [folder / f"{one}.zarr" for one in ("frames", "poses", "splats")]
    options = PromptsOptions(**{"backend": "auto", "seed": 0} | changes)
    depth_prompts_stage.run(*inputs, folder / f"{name}.zarr", options)
    return verify(folder / f"{name}.zarr", SCHEMAS)


def numbers(prompts, frame):
    """(CELLS, CELLS) points in each cell of a frame."""
    found = prompts.read("position")[prompts.read("frame") == frame]
    column, row = (found * CELLS).astype(int).T
    return np.bincount(row * CELLS + column, minlength=CELLS**2).reshape(CELLS, CELLS)


def test_a_plane_is_prompted_by_its_distance_over_the_nearest(plane):
    """The middle of the plane is nearest in the first view. Cells without valid pixels have a point each."""
    prompts = prompts_of(plane)
    assert np.unique(prompts.read("frame")).tolist() == [0, 1, 2, 3, 5]
    for frame, side in ((0, 4), (1, 5), (2, 8)):
        found = numbers(prompts, frame)
        # Away from the edges of the first view, whose least depths are larger outside.
        assert (found[3:5, 3:5] == side**2).all() and (found[0] == 1).all(), frame
    for cell in (4, 5, 6):
        assert numbers(prompts, 3)[cell, 4] == int(4 * ratio_of(6.0, cell)) ** 2, cell
    half = numbers(prompts, HALF)
    assert (half[1:, :3] == 4**2).all() and (half[1:, 5:] == 1).all()
    again, other = prompts_of(plane, "again"), prompts_of(plane, "other", seed=1)
    assert np.array_equal(again.read("position"), prompts.read("position"))
    assert not np.array_equal(other.read("position"), prompts.read("position"))


@pytest.mark.parametrize("behind, seen", [(2.4, True), (2.8, False)])
def test_a_view_does_not_see_gaussians_far_behind_its_surface(behind, seen):
    """A wall 2 m ahead hides another one, unless that is nearer than a quarter more."""
    wall = plane_of(2.0)
    both = Gaussians.concatenate([wall, plane_of(behind)])
    views = SplatViews(both, SETTINGS, CAMERA, np.eye(4)[None], np.ones((SIDE, SIDE), bool))
    depth, gaussian, pixel = views.look(0)
    assert depth == pytest.approx(2.0, abs=1e-2) and len(pixel) == len(gaussian)
    assert (gaussian >= wall.count).any() == seen and (gaussian < wall.count).any()


KEYS = {
    "image_size": 128,
    "crops_per_side": 1,
    "points_per_side": 4,
    "key_frame_stride": 1,
    "track_moving": "never",
}


@pytest.fixture(autouse=True)
def all_masks(monkeypatch):
    """No mask is dropped for its quality."""
    monkeypatch.setitem(MASK_FILTERS, "auto", MaskFilter(0.0, 0.0, 0.1, 0.2))


def segmented(folder, name, points="depth", prompts=None, **changes):
    options = SegmentsOptions(**KEYS | {"point_prompts": points} | changes)
    stage.run(folder / "frames.zarr", folder / f"{name}.zarr", options, prompts_path=prompts)
    return open_artifact(folder / f"{name}.zarr", SEGMENTS)


def test_frames_are_segmented_from_their_points_alone(plane):
    """With the points of the grid, the masks are those of the grid; crops are not prompted, and other frames are left."""
    grid = grid_points(4).numpy()
    arrays = {"frame": np.repeat(np.array([1, 3], np.int32), 16), "position": np.tile(grid, (2, 1))}
    given = put(plane, "prompts", arrays, made_from=["frames"])
    by_depth = segmented(plane, "by_depth", prompts=given, crops_per_side=2)
    by_grid = segmented(plane, "by_grid", points="grid")
    assert by_depth.facts["key_frames"] == [1, 3] and by_depth.facts["single_frames"]
    assert by_grid.facts["key_frames"] == [0, 1, 2, 3, 5]
    one, other = by_depth.read("labels"), by_grid.read("labels")
    assert (one[[0, 2, 4, 5]] == -1).all() and (one[[1, 3]] >= 0).any()
    for frame in (1, 3):
        # The same masks, numbered from another first one.
        first, second = (np.unique(labels[frame], return_inverse=True)[1] for labels in (one, other))
        assert np.array_equal(first, second)
    assert by_depth.provenance["inputs"]["prompts.zarr"] == open_artifact(given, SCHEMAS["prompts"]).digest


def test_points_that_are_missing_or_of_other_frames_are_an_error(plane, tmp_path):
    with pytest.raises(UserError, match=r"segments\.point_prompts.*--prompts"):
        segmented(plane, "none")
    other = put(tmp_path, "prompts", inputs={"frames.zarr": "another"})
    with pytest.raises(UserError, match=r"prompts\.zarr.*frames\.zarr"):
        segmented(plane, "none", prompts=other)
