"""SAM2 is loaded from files and runs on images of any size; invalid files are reported."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from hydra.core.global_hydra import GlobalHydra
from PIL import Image
from safetensors.torch import load_file
from torch import nn

from benchmarks.small_sam2.segmenters import image_predictor
from egosplat.errors import UserError
from egosplat.models.sam2_loader import Sam2, build_predictor, load_sam2
from egosplat.models.video_predictor import FILLED, fill_holes


@pytest.fixture
def load(tiny_sam2) -> Callable[..., Sam2]:
    """``load(config, precision, side)``: the tiny SAM2."""

    def make(
        config: Path = tiny_sam2 / "sam2.yaml", precision: str = "float32", side: int | None = None
    ) -> Sam2:
        return load_sam2(str(config), str(tiny_sam2 / "model.safetensors"), "cpu", precision, side)

    return make


@pytest.fixture
def sam2(load) -> Sam2:
    return load()


def test_half_precision_is_loaded_into_float32(sam2, tiny_sam2):
    saved = load_file(tiny_sam2 / "model.safetensors")
    loaded = sam2.video_predictor.state_dict()
    assert loaded.keys() == saved.keys()
    assert all(value.dtype == torch.float32 for value in loaded.values())
    assert all(torch.equal(loaded[name], saved[name].float()) for name in saved)
    assert not any(weight.requires_grad for weight in sam2.video_predictor.parameters())


def test_no_tensor_is_left_as_it_was_before_loading(sam2, load):
    torch.manual_seed(torch.initial_seed() + 1)
    again = load().video_predictor
    for of in (nn.Module.parameters, nn.Module.buffers):
        pair = of(sam2.video_predictor), of(again)
        assert all(torch.equal(a, b) for a, b in zip(*pair, strict=True))


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_masks_are_of_the_image_size(load, image, precision):
    sam2 = load(precision=precision)
    predictor = image_predictor(sam2)
    with sam2.compute.inference():
        predictor.set_image(image)
        masks, scores, logits = predictor.predict(np.array([[30.0, 40.0]]), np.array([1]))
    assert masks.shape == (3, 77, 101) and scores.shape == (3,) and logits.shape == (3, 64, 64)
    assert np.isfinite(scores).all() and np.isfinite(logits).all()


def test_set_image_size_equals_a_model_built_for_that_size(load, model_tree, image, tmp_path):
    model_tree["model"]["image_size"] = 192
    (tmp_path / "large.yaml").write_text(yaml.safe_dump(model_tree))
    answers = []
    for sam2 in (load(tmp_path / "large.yaml"), load(side=192)):
        predictor = image_predictor(sam2)
        with sam2.compute.inference():
            predictor.set_image(image)
            answers.append(predictor.predict(np.array([[30.0, 40.0]]), np.array([1])))
    assert answers[1][2].shape == (3, 48, 48)
    for made, changed in zip(*answers, strict=True):
        np.testing.assert_array_equal(made, changed)


POINT = {"points": np.array([[30.0, 40.0]], np.float32), "labels": np.array([1], np.int32)}


def test_objects_are_tracked_through_a_video_without_warnings(sam2, tmp_path, recwarn):
    for number in range(3):
        colors = np.random.default_rng(number).integers(0, 256, (77, 101, 3), dtype=np.uint8)
        Image.fromarray(colors).save(tmp_path / f"{number}.jpg")
    predictor = sam2.video_predictor
    with sam2.compute.inference():
        state = predictor.init_state(str(tmp_path))
        predictor.add_new_points_or_box(state, 0, 7, **POINT)
        seen = [(frame, [*names], masks.shape) for frame, names, masks in predictor.propagate_in_video(state)]
    assert seen == [(frame, [7], (1, 1, 77, 101)) for frame in range(3)]
    assert not [warning for warning in recwarn if "post-processing" in str(warning.message)]


def test_small_holes_of_a_tracked_object_are_filled(sam2, tmp_path, monkeypatch):
    Image.fromarray(np.zeros((64, 64, 3), dtype=np.uint8)).save(tmp_path / "0.jpg")
    holed = torch.full((1, 1, 64, 64), 5.0)
    holed[..., 20:22, 20:22] = -5.0
    track = type(sam2.video_predictor).track_step

    def with_hole(self, **arguments):
        return track(self, **arguments) | {"pred_masks": holed}

    monkeypatch.setattr(type(sam2.video_predictor), "track_step", with_hole)
    predictor = sam2.video_predictor
    with sam2.compute.inference():
        state = predictor.init_state(str(tmp_path))
        _, _, masks = predictor.add_new_points_or_box(state, 0, 1, **POINT)
    assert (masks > 0).all()


def test_hydra_s_global_state_is_left_alone(load):
    import sam2  # noqa: F401  sets that state up itself when it is first imported

    hydra = GlobalHydra.instance()
    before = hydra.hydra
    load()
    assert hydra.hydra is before
    hydra.hydra = None
    try:
        load()
        assert hydra.hydra is None
    finally:
        hydra.hydra = before


def test_a_checkpoint_of_another_architecture_is_reported(load, model_tree, tmp_path):
    model_tree["model"]["num_maskmem"] = 5
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(model_tree))
    with pytest.raises(UserError, match="maskmem_tpos_enc, 3x1x1x8 .*5x1x1x8"):
        load(tmp_path / "other.yaml")


BASE = "sam2.modeling.sam2_base.SAM2Base"


@pytest.mark.parametrize(
    "text, message",
    [
        *((text, "describes no SAM2") for text in ("model: [", "3", "[" * 5000)),
        *(
            (text, "'model' with a _target_")
            for text in ("model: {}", "- 1", "model: 3", f"a: {{_target_: {BASE}}}")
        ),
        ("model: {_target_: os.system, command: 'touch ran'}", "'os.system' is no network"),
        ("model: {_target_: sam2.build_sam.os.system, command: 'touch ran'}", "build_sam.os.system' is no"),
        (f"model: {{_target_: {BASE}, x: [{{_target_: sam2.build_sam.os.system}}]}}", "os.system' is no"),
        ("model: {_target_: sam2.build_sam.build_sam2_hf, model_id: a/b}", "build_sam2_hf' is no network"),
        *((f"model: {{_target_: {name}}}", f"'{name}' is no network") for name in ("sam2.nothing.Here", "3")),
        (f"model: {{_target_: {BASE}}}", "describes no SAM2"),
        (f"model: {{_target_: {BASE}, image_size: '${{nothing}}'}}", "describes no SAM2"),
    ],
)
def test_an_invalid_sam2_description_is_reported(tmp_path, folder, text, message):
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(UserError, match=f"own.yaml: .*{message}") as caught:
        build_predictor(tmp_path / "own.yaml")
    assert len(str(caught.value).splitlines()) <= 2
    assert not (tmp_path / "ran").exists()


def ring(side: int, hole: int) -> torch.Tensor:
    """A square of score 5 with a square hole of score -5 in its middle, on a background of -5."""
    scores = torch.full((16, 16), -5.0)
    scores[2 : 2 + side, 2 : 2 + side] = 5.0
    scores[4 : 4 + hole, 4 : 4 + hole] = -5.0
    return scores


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("area, filled", [(8, False), (9, True)])
def test_a_hole_is_filled_up_to_the_given_area(area, filled, dtype):
    scores = ring(9, hole=3).to(dtype)
    result = fill_holes(scores, area)
    assert result.dtype == dtype
    hole = torch.zeros_like(scores, dtype=torch.bool)
    hole[4:7, 4:7] = filled
    assert torch.equal(result, torch.where(hole, torch.tensor(FILLED, dtype=dtype), scores))


def test_each_mask_is_filled_independently_and_no_hole_that_a_corner_connects():
    full, corner = torch.full((16, 16), 5.0), ring(9, 2)
    corner[3, 3] = corner[2, 2] = -5.0
    scores = torch.stack([full, ring(9, 1), -full, corner])[:, None]
    result = fill_holes(scores, 9)
    assert result[1, 0, 4, 4] == FILLED and (result != scores).sum() == 1
    assert fill_holes(scores[:0], 9).shape == (0, 1, 16, 16)
