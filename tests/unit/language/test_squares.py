"""Two flat squares with known features: every method that trains answers them right from a place it has not seen."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import TILE_SCALES, TILES
from egosplat.errors import UserError
from egosplat.gaussians.render import view_of
from egosplat.gaussians.training_views import Masking
from egosplat.language.decoder import Decoder, decode
from egosplat.language.method import Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews, select_code_views
from egosplat.pipeline.config import defaults, stage_values
from egosplat.pipeline.stages import STAGES, load_module
from egosplat.query.answers import ViewMatch
from egosplat.query.scene import QueryScene, Viewpoint
from egosplat.query.text import Texts
from egosplat.query.views import Asker
from egosplat.rasterize.view import render_codes
from egosplat_rivals import loop
from egosplat_rivals.tile_views import TileViews, pyramid
from tests.support.gaussian_scene import SETTINGS, opaque
from tests.support.langsplat import LANGSPLAT
from tests.support.scenes import camera_facts, put, put_scene
from tests.unit.language.conftest import (
    CAMERA,
    CLUSTERED,
    FRAME_COUNT,
    HELD_OUT,
    LINEAR,
    SIZE,
    feature_arrays,
    open_features,
)

CPU = torch.device("cpu")
NAMES = ["subpart", "part", "whole"]
FEATURE = np.eye(8, dtype=np.float32)[:2]

# Of each method, iterations that suffice for so small a scene.
ITERATIONS = {"sparse": 120, "granular": 150, "field": 100, "quantized": 500}
LONG = [pytest.param(name, marks=pytest.mark.slow) for name in ITERATIONS]
METHODS = [name for name in STAGES["language"].modules if name not in ("joint", "clustered", *ITERATIONS)]
METHODS += [CLUSTERED, *LONG]


@pytest.fixture(scope="module")
def squares():
    """Opaque Gaussians on two squares 2 m ahead, with a gap between them."""
    side = np.linspace(-0.6, 0.6, 13)
    grid = np.stack(np.meshgrid(side, side, [2.0]), axis=-1).reshape(-1, 3)
    xyz = np.concatenate([grid + [-0.9, 0, 0], grid + [0.9, 0, 0]])
    return opaque(xyz, np.zeros((len(xyz), 3), np.uint8))


def square_of(pose: np.ndarray, margin: float) -> np.ndarray:
    """(SIZE, SIZE) 0 on the left square, 1 on the right one, -1 outside or within ``margin`` of an edge [m]."""
    at = (np.arange(SIZE) + 0.5 - SIZE / 2) / CAMERA.fx * 2.0
    x, y = np.meshgrid(at + pose[0, 3], at + pose[1, 3])
    inside = (abs(abs(x) - 0.9) < 0.6 - margin) & (abs(y) < 0.6 - margin)
    return np.where(inside, (x > 0).astype(np.int32), -1)


@pytest.fixture(scope="module")
def scene(tmp_path_factory, squares, camera_to_world, unrefined):
    """Gaussians, views and targets of the squares; instance 2 l + s is square s at level l."""
    folder = tmp_path_factory.mktemp("squares")
    square = np.stack([square_of(pose, 0.0) for pose in camera_to_world])
    levels = 2 * np.arange(3)[None, :, None, None]
    labels = np.where(square[:, None] < 0, -1, square[:, None] + levels).astype(np.int32)
    views = np.argwhere(np.ones((6, FRAME_COUNT))).astype(np.int32)
    arrays = {
        "rgb": np.zeros((FRAME_COUNT, SIZE, SIZE, 3), np.uint8),
        "train": np.arange(FRAME_COUNT) != HELD_OUT,
        "camera_to_world": camera_to_world,
        "intrinsics": CAMERA.matrix,
    }
    put_scene(folder, ["frames", "poses"], arrays, camera_facts(CAMERA))
    level = np.arange(6, dtype=np.int8) // 2
    put(folder, "instances", {"labels": labels, "instances/level": level}, {"levels": NAMES})
    about = {"levels": NAMES, "decoder": {"widths": [8]}}
    arrays = feature_arrays(FEATURE[np.arange(6) % 2], level, views)
    put(folder, "features", arrays, about, options=LINEAR | {"supervision": "view"}, made_from=["instances"])
    frames, poses, instances, found = open_features(folder)
    targets = CodeTargets(instances, found, CPU)
    views = select_code_views(frames, poses, unrefined, targets.of, Masking(None, ""), squares, SETTINGS)
    put_tiles(folder, camera_to_world)
    tiles = TileViews([open_artifact(folder / "tiles.zarr", TILES)], frames, CPU)
    return Scene(views, targets, tiles)


def put_tiles(folder, camera_to_world: np.ndarray) -> None:
    """Write tiles whose feature is that of the square on their side of the middle."""
    scales = pyramid(SIZE, SIZE)
    trained = np.flatnonzero(np.arange(FRAME_COUNT) != HELD_OUT)
    arrays = {"frame": trained.astype(np.int32)}
    for number, scale in enumerate(scales):
        at = scale.first + 0.5 + scale.stride * np.arange(scale.columns)
        x = (at - SIZE / 2) / CAMERA.fx * 2.0 + camera_to_world[trained, None, 0, 3]
        rows = FEATURE[(x > 0).astype(int)][:, None].repeat(scale.rows, axis=1)
        arrays[TILE_SCALES[number]] = rows.astype(np.float16)
    side = np.where(np.arange(6) < 3, -1.0, 1.0).astype(np.float16)
    arrays["regulariser"] = np.tile(side[:, None], (len(trained), 6, 1, 2))
    facts = {"scales": [asdict(scale) for scale in scales], "clip": {"small": True}}
    put(folder, "tiles", arrays, facts, made_from=["frames"])


@dataclass
class Scene:
    """What methods take."""

    views: CodeViews
    targets: CodeTargets
    tiles: TileViews

    def coded(self, method: str, checkpoint: Checkpoint, **changes: object) -> Coded:
        keys = {"method": method, "iterations": ITERATIONS.get(method, 150), "pixels": 200, "lr": 0.02}
        options = LanguageOptions(**stage_values("language", defaults()) | keys | changes)
        how: Method = load_module("language", method).METHOD
        targets = self.tiles if TILES in how.learns_from else self.targets
        return how.give_codes(self.views, targets, options, checkpoint)

    def answers(self, coded: Coded, pose: np.ndarray, words: np.ndarray, readout: str) -> list[ViewMatch]:
        """Answer two queries, whose features are the rows of ``words``, in one view."""
        decoder = coded.decoder or Decoder((8,), np.zeros(0, np.float32))
        camera, codes = self.views.camera, (coded.code, coded.share, decoder, coded.levels)
        texts = Texts(("left", "right"), torch.from_numpy(words), torch.eye(8)[2:3])
        known = QueryScene(self.views.gaussians, SETTINGS, camera, 0, *codes, coded.maps_only)
        asker = Asker(known, texts, LANGSPLAT.change(readout=readout))
        return list(asker.ask(texts.phrases, camera, Viewpoint("", pose, None)))


@pytest.fixture(scope="module")
def coded(scene, tmp_path_factory) -> Callable[[str], Coded]:
    """Codes of the scene as it is, by method; each trains once for all tests."""

    @cache
    def found(method: str) -> Coded:
        return scene.coded(method, Checkpoint(tmp_path_factory.mktemp("codes") / "language.zarr", "key", 1e9))

    return found


@pytest.mark.parametrize("readout", ["gaussians", "pixels"])
@pytest.mark.parametrize("method", METHODS)
def test_an_answer_depends_on_its_word_alone(scene, camera_to_world, coded, method, readout):
    """Each word finds its own square and nothing of the other one. With the words exchanged, the answers are exchanged."""
    pose = camera_to_world[HELD_OUT]
    # Gaussians reach over the edges of their square.
    shown, inside = square_of(pose, -0.15), square_of(pose, 0.15)
    coded = coded(method)
    found = scene.answers(coded, pose, FEATURE, readout)
    for side, answer in enumerate(found):
        column, row = answer.pixel
        assert shown[row, column] == side and answer.score > 0.9
        assert answer.mask[inside == side].mean() > 0.5 and not answer.mask[inside == 1 - side].any()
    if method in ITERATIONS:
        # The codebook of quantized has another loss, and comes first.
        losses = [loss for _, loss in coded.curve]
        assert losses[-1] < max(losses) and len(coded.stands_in) >= 2
    assert coded.maps_only == (method in ("field", "quantized"))
    exchanged = scene.answers(coded, pose, FEATURE[::-1].copy(), readout)
    for answer, before in zip(exchanged, found[::-1], strict=True):
        assert np.allclose(answer.relevancy, before.relevancy, atol=1e-6)
        assert (answer.level, answer.mask_level) == (before.level, before.mask_level)
        assert np.array_equal(answer.mask, before.mask)


@pytest.mark.parametrize("method", METHODS)
def test_with_the_poses_of_other_views_each_square_gets_the_other_feature(
    scene, camera_to_world, checkpoint, method
):
    """Guards against a method that does not use the poses. Half of the views show the right square where the left one was,
    the others the left one where the right one was."""
    wrong = scene.views.camera_to_world.copy()
    wrong[:, 0, 3] += np.where(np.arange(len(wrong)) % 2, 1.8, -1.8)
    scene = replace(scene, views=replace(scene.views, camera_to_world=wrong))
    # A view shows one square alone, so a decoder takes longer to tell them apart.
    longer = {"iterations": 200, "lr": 0.06} if method == "granular" else {}
    coded = scene.coded(method, checkpoint, **longer)
    pose = camera_to_world[HELD_OUT]
    view = view_of(scene.views.gaussians, CAMERA, pose, SETTINGS)
    rendered, _ = render_codes(view, coded.code, coded.share)
    square = square_of(pose, 0.15)
    for level, name in enumerate(coded.levels):
        codes = rendered[level]
        features = codes if coded.decoder is None else decode(codes, coded.decoder)
        sides = torch.stack([features[torch.from_numpy(square == side)].mean(dim=0) for side in (0, 1)])
        cosines = sides @ torch.from_numpy(FEATURE.T)
        assert cosines.fliplr().trace() > cosines.trace() + 0.5, name


@pytest.mark.parametrize("method", LONG)
def test_a_killed_training_goes_on_to_the_same_result(scene, tmp_path, method, monkeypatch):
    def run(name: str):
        kept = Checkpoint(tmp_path / f"{name}.zarr", "key", 0.0)
        return scene.coded(method, kept, iterations=20)

    before = {name: values.clone() for name, values in scene.views.gaussians.parameters().items()}
    whole = run("whole")
    iterate = loop._Training.iterate

    def killed(self, iteration: int) -> None:
        if iteration == 11:
            raise KeyboardInterrupt
        iterate(self, iteration)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(loop._Training, "iterate", killed)
        run("killed")
    rest = run("killed")
    assert torch.equal(whole.code, rest.code) and whole.curve == rest.curve
    assert np.array_equal(whole.decoder.values, rest.decoder.values)
    assert whole.decoder.widths == rest.decoder.widths
    for name, values in scene.views.gaussians.parameters().items():
        assert torch.equal(values, before[name]) and values.grad is None, "the geometry learns nothing"


def test_methods_from_tiles_say_which_frame_lacks_them(scene, checkpoint):
    scene = replace(scene, views=replace(scene.views, frame=np.array([0, HELD_OUT])))
    with pytest.raises(UserError, match=f"frame {HELD_OUT}"):
        scene.coded("field", checkpoint)


@pytest.mark.parametrize("method", LONG)
def test_a_view_that_shows_nothing_does_not_end_training(scene, checkpoint, method):
    away = scene.views.camera_to_world.copy()
    away[1, 2, 3] = 50.0
    for change in ({"camera_to_world": away}, {"camera_to_world": away, "valid": torch.zeros(SIZE, SIZE)}):
        changed = replace(scene, views=replace(scene.views, **change))
        assert np.isfinite(changed.coded(method, checkpoint, iterations=10).curve).all()
