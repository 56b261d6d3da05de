"""Stage masks scores instances on training frames and masks the transient ones in all frames."""

from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import INSTANCES, SCHEMAS
from egosplat.errors import UserError
from egosplat.transient import masks_stage
from tests.support.scenes import put

SIZE, FRAME_COUNT = 32, 6


def predict(folder: Path, probability: np.ndarray, inputs: dict[str, str] | None = None, **more: np.ndarray):
    """Write transient.zarr with a probability, and what stands out; returns the folder."""
    put(folder, "transient", {"probability": probability.astype(np.float16)} | more, inputs=inputs)
    return folder


def labels_of(folder: Path) -> np.ndarray:
    """(6, 32, 32) labels of whole instances."""
    return open_artifact(folder / "instances.zarr", INSTANCES).read("labels")[:, 2]


def predicted(folder: Path) -> Path:
    """The square is half transient everywhere, the lower half a little in one frame."""
    labels = labels_of(folder)
    probability = np.where(labels == 0, 0.5, 0.0)
    probability[0][labels[0] == 1] = 0.06
    return predict(folder, probability)


def run(folder: Path, **keys: object):
    """The verified artifact, by default by the paper's rule: whole instances by their mean probability."""
    stage_keys = {"threshold": 0.25, "recipe": "paper"} | keys
    inputs = (folder / f"{name}.zarr" for name in ("frames", "transient", "instances"))
    masks_stage.run(*inputs, folder / "masks.zarr", masks_stage.MasksOptions(**stage_keys))
    return verify(folder / "masks.zarr", SCHEMAS)


def test_artifact_holds_the_expected_facts_and_inputs(scene, pictures):
    masks = run(predicted(scene()))
    # A little of the lower half is transient in one of five training frames.
    assert masks.read("instances/score") == pytest.approx([0.5, 0.06 / 5, 0.0], abs=1e-4)
    assert masks.read("instances/transient").tolist() == [True, False, False]
    square = (pictures == 255).all(axis=-1)
    assert (masks.read("refined") == square).all()
    facts = masks.facts
    assert (facts["transient"], facts["instances"], facts["empty"]) == (1, 3, 1)
    assert facts["masked_share"] == pytest.approx(square.mean())
    inputs = {f"{name}.zarr" for name in ("frames", "instances", "transient")}
    assert masks.origin == "synthetic" and set(masks.provenance["inputs"]) == inputs


def test_evaluation_frames_decide_nothing_and_are_masked(scene):
    """Frame 3 is held out: its probabilities change no score, but its instances are masked."""
    folder = scene()
    probability = np.where(labels_of(folder) == 0, 0.5, 0.0)
    before = run(predict(folder, probability))
    probability[3] = 1.0 - probability[3]
    after = run(predict(folder, probability))
    for name in ("instances/score", "instances/transient", "refined"):
        assert (after.read(name) == before.read(name)).all()
    assert after.read("refined")[3].any() and not after.read("instances/transient")[1]


def test_an_instance_of_evaluation_frames_alone_is_not_transient(scene):
    labels = np.full((FRAME_COUNT, 3, SIZE, SIZE), -1, np.int32)
    labels[3, 2] = 0
    masks = run(predict(scene(labels=labels), np.ones((FRAME_COUNT, SIZE, SIZE))))
    assert not masks.read("instances/transient").any() and masks.facts["empty"] == 3


@pytest.mark.parametrize(("width", "inputs"), [(SIZE // 2, None), (SIZE, {"frames.zarr": "another"})])
def test_inputs_of_other_frames_are_rejected(scene, width, inputs):
    folder = predict(scene(), np.zeros((FRAME_COUNT, SIZE, width)), inputs)
    with pytest.raises(UserError, match="transient.zarr: was made from another frames.zarr"):
        run(folder)


@pytest.mark.parametrize(
    ("rows", "recipe", "changes", "masked"),
    [
        (8, "own", {}, True),
        (1, "own", {}, False),
        (1, "paper", {}, True),
        # What was not measured decides nothing, as with an absolute penalty.
        (0, "own", {"residual_scale": np.full(FRAME_COUNT, np.nan, np.float32)}, True),
        (0, "own", {"compared": np.zeros((SIZE, SIZE), bool)}, True),
    ],
)
def test_an_instance_that_looks_static_is_not_masked(scene, monkeypatch, rows, recipe, changes, masked):
    """A square that the network calls transient, and of which a share stands out."""
    monkeypatch.setattr(masks_stage, "MAX_SHARE", 1.0)
    folder = scene()
    square = labels_of(folder) == 0
    arrays = {
        "stands_out": square & (np.cumsum(square, axis=1) <= rows),
        "residual_scale": np.full(FRAME_COUNT, 0.01, np.float32),
        "compared": np.ones((SIZE, SIZE), bool),
    }
    masks = run(predict(folder, np.where(square, 0.8, 0.0), **arrays | changes), recipe=recipe)
    assert masks.read("instances/transient")[0] == masks.read("refined").any() == masked
    assert masked or 0 < masks.read("instances/stands_out")[0] < 0.5


def test_a_pixel_that_the_network_calls_static_is_not_masked(scene, monkeypatch):
    monkeypatch.setattr(masks_stage, "MAX_SHARE", 1.0)
    folder = scene()
    made = labels_of(folder) == 0
    probability = np.where(made, 0.5, 0.0)
    probability[0] = 0.0
    masks = run(predict(folder, probability), recipe="own")
    assert not masks.read("refined")[0].any() and (masks.read("refined")[1:] == made[1:]).all()


def test_masks_that_are_merged_in_3d_are_not_masked(scene):
    for moving in (False, True):
        made = scene({"source": "masks"}, **{"instances/moving": np.array([moving, False, False])})
        masks = run(predicted(made))
        assert masks.read("instances/transient").tolist() == [moving, False, False]
        assert masks.read("instances/score")[0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("probability", "recipe", "reason"),
    [(0.51, "own", "probability"), (0.49, "own", "instances"), (0.49, "paper", None)],
)
def test_nothing_is_masked_where_half_is_transient(scene, probability, recipe, reason):
    """A network that failed masks nothing instead of half of the scene, and the artifact says why."""
    folder = predict(scene(), np.full((FRAME_COUNT, SIZE, SIZE), probability))
    masks = run(folder, threshold=0.45, recipe=recipe)
    assert masks.facts["withheld"] == reason
    assert masks.read("refined").any() == masks.read("instances/transient").any() == (reason is None)


@pytest.mark.parametrize("recipe", ["own", "paper"])
def test_pixels_that_a_frame_leaves_out_say_nothing_of_an_instance(scene, pictures, recipe):
    """The square is transient where its own masks hide it alone: it is not transient, and not masked again."""
    hidden = (pictures == 255).all(axis=-1)
    hidden[:, :, 16:] = False
    made = scene(masked=hidden)
    predict(made, np.where(hidden, 1.0, np.where(labels_of(made) == 0, 0.1, 0.0)))
    masks = run(made, recipe=recipe)
    assert masks.read("instances/score")[0] == pytest.approx(0.1, abs=1e-3)
    assert not masks.read("refined").any()
    assert masks.facts["mean_probability"] < 0.02
