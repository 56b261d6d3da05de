"""Training SAM2: losses prefer the truth, steps train every weight, a stopped run resumes exactly."""

import dataclasses
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from omegaconf import OmegaConf

from egosplat.errors import UserError
from egosplat.models.sam2_loader import set_image_size
from training import sam2 as train_sam2
from training.sam2 import Run
from training.small_models import sam2_curve, sam2_steps
from training.small_models.sam2_losses import Names, PixelPairs, mask_iou, mask_loss
from training.small_models.sam2_recipe import Recipe, recipe_from_weights
from training.small_models.schedule import read_state, save_state
from training.small_models.worlds import RenderedWorld

pytestmark = pytest.mark.slow

ONE = dict.fromkeys(("pictures", "clips", "warm_up"), 1)
RECIPE = Recipe(steps=4, seed=3, clips_from=0.5, sides=(128, 192), points=3, frames=3, tracks=2, **ONE)


@pytest.fixture(autouse=True)
def one_iteration_of_muon(monkeypatch):
    """Instead of five: its products in bfloat16 take most of a step on a CPU, and no test is of their number."""
    monkeypatch.setattr(torch.optim, "Muon", partial(torch.optim.Muon, ns_steps=1))


@pytest.fixture(scope="module")
def world():
    rng = np.random.default_rng(0)
    rows, columns = np.indices((64, 64)) // 16
    subpart = np.stack([np.roll(rows * 4 + columns, 2 * frame, axis=1) for frame in range(3)])[None].astype(
        np.uint16
    )
    colors = rng.integers(0, 256, (16, 3), dtype=np.uint8)
    tables = np.stack([np.arange(16), np.arange(16) // 2, np.arange(16) // 4])
    tables = np.pad(tables, ((0, 0), (0, 1)), constant_values=-1).astype(np.int32)
    return RenderedWorld(
        colors[subpart],
        subpart,
        tables,
        tuple("abcd"),
        ("legs 0", "legs 1", "back", "seat", "lid", "body", "rim", "foot"),
    )


def test_mask_loss_decreases_towards_the_truth():
    share = torch.zeros(3, 16, 16)
    share[:, 4:9, 5:12] = 1.0
    right, unsure = (2 * share - 1) * 8, torch.zeros(3, 16, 16)
    for balance in (0.0, 0.5):
        losses = [mask_loss(logits, share, balance) for logits in (right, unsure, -right)]
        assert (losses[0] < 0.01).all() and (losses[0] < losses[1]).all() and (losses[1] < losses[2]).all()
    extreme = mask_loss(torch.full((1, 16, 16), 1e4), torch.zeros(1, 16, 16), 0.5)
    assert extreme.isfinite().all()


def test_mask_iou_compares_enlarged_masks():
    share = torch.zeros(1, 2, 16, 16)
    share[0, 0, 4:8, 4:12] = 1.0
    logits = torch.full((1, 2, 8, 8), -5.0)
    logits[0, 0, 2:4, 2:6] = 5.0
    found = mask_iou(logits, share)
    assert found.shape == (1, 2)
    assert found[0, 0] > 0.6 and found[0, 1] == 1.0, "two empty masks have IoU 1"


def test_pair_loss_pulls_pixels_of_one_object_together():
    torch.manual_seed(0)
    pairs = PixelPairs(3, samples=64)
    labels = (torch.arange(256).reshape(1, 1, 16, 16) // 64).expand(2, 3, 16, 16)
    told = torch.nn.functional.one_hot(labels[:, 0] % 3, 3).permute(0, 3, 1, 2).float()
    for projection in pairs.projections:
        torch.nn.init.eye_(projection.weight)
    torch.manual_seed(1)
    apart = pairs(10 * told, labels % 3)
    torch.manual_seed(1)
    together = pairs(0 * told, labels % 3)
    assert apart < 0.1 < together


def test_auxiliary_loss_trains_names_and_borders():
    names = (torch.arange(256).reshape(1, 16, 16) // 64).long()
    labels = names[:, None].expand(1, 3, 16, 16)
    module = Names(4, names=4)
    told = torch.nn.functional.one_hot(names, 4).permute(0, 3, 1, 2).float()
    torch.nn.init.zeros_(module.names.weight)
    with torch.no_grad():
        module.names.bias.zero_()
        unsure = module(told, labels, names)
        module.names.weight[:, :, 0, 0] = 10 * torch.eye(4)
        sure = module(told, labels, names)
    assert float(unsure - sure) == pytest.approx(0.5 * np.log(4), abs=0.01)
    nothing = torch.full_like(names, -1)
    assert module(told, torch.full_like(labels, -1), nothing).isfinite()


def test_memory_of_a_given_mask_equals_sam2_s(world, tmp_path):
    model = Run(RECIPE, [world], tmp_path / "state.pt", torch.device("cpu")).model.eval()
    set_image_size(model, 256)
    torch.manual_seed(0)
    features = [torch.randn(2, 16, 64, 64), torch.randn(2, 32, 32, 32), torch.randn(2, 128, 16, 16)]
    prompt = torch.zeros(2, 1, 256, 256)
    prompt[0, 0, 40:90, 60:120] = prompt[1, 0, 200:, :30] = 1.0
    with torch.no_grad():
        kept, _, presence = sam2_steps._begin(model, features, prompt)
        _, _, _, _, high, pointer, score = model._use_mask_as_output(features[2], features[:2], prompt)
        tokens = features[2].flatten(2).permute(2, 0, 1)
        stored, _ = model._encode_new_memory([tokens], [(16, 16)], high, score, True)
    assert presence.shape == (2,)
    torch.testing.assert_close(kept["obj_ptr"], pointer)
    torch.testing.assert_close(kept["maskmem_features"], stored)


def test_each_kind_of_step_gives_gradients_to_all_weights_that_it_uses(world, tmp_path):
    run = Run(RECIPE, [world], tmp_path / "state.pt", torch.device("cpu"))
    # The pointer is computed only for visible objects.
    torch.nn.init.constant_(run.model.sam_mask_decoder.pred_obj_score_head.layers[-1].bias, 5.0)
    trained = set()
    for step in (0, 3):
        run.step = step
        before = {name: value.detach().clone() for name, value in run.model.named_parameters()}
        run._take(run._sample(step))
        changed = {
            name
            for name, value in run.model.named_parameters()
            if value.grad is not None and value.grad.any()
        }
        assert changed and all(value.isfinite().all() for value in run.model.parameters())
        assert any(not torch.equal(before[name], value) for name, value in run.model.named_parameters())
        trained |= changed
    rooms = {name.split(".")[0] for name in trained}
    assert {
        "image_encoder",
        "memory_attention",
        "memory_encoder",
        "sam_mask_decoder",
        "obj_ptr_proj",
    } <= rooms
    assert {"maskmem_tpos_enc", "no_mem_embed", "sam_prompt_encoder"} <= rooms


def test_a_stopped_run_resumes_to_the_same_weights_and_the_same_curve(world, tmp_path, monkeypatch):
    held_out = [dataclasses.replace(world, rgb=world.rgb[..., ::-1])]

    def run(name):
        (tmp_path / name).mkdir(exist_ok=True)
        return Run(RECIPE, [world], tmp_path / name / "s.pt", torch.device("cpu"), held_out=held_out, every=2)

    whole, killed = run("whole"), run("killed")
    whole.train()
    take, saves = killed._take, []

    def take_three(sampled):
        if killed.step == 3:
            raise KeyboardInterrupt
        take(sampled)
        # The last state is older than the last row.
        if killed.step == 1:
            saves.append(killed._save())

    monkeypatch.setattr(killed, "_take", take_three)
    with pytest.raises(KeyboardInterrupt):
        killed.train()
    assert saves and [row["step"] for row in killed.curve] == [0, 2]
    resumed = run("killed")
    assert resumed.step == 1 and [row["step"] for row in resumed.curve] == [0]
    # Neither other draws from torch's generator nor the number of sampling threads change the result.
    torch.rand(7)
    resumed.samplers = 3
    resumed.train()
    for name, value in whole.average.weights.items():
        torch.testing.assert_close(resumed.average.weights[name], value, rtol=0, atol=0, msg=name)
    tables = [pd.read_table(tmp_path / name / "curve.tsv") for name in ("whole", "killed")]
    assert tables[0]["step"].tolist() == [0, 2, 4] and tables[0]["core-hours"].is_monotonic_increasing
    pd.testing.assert_frame_equal(*(table.drop(columns="core-hours") for table in tables))
    assert tables[0][["> 5 %", "tracked"]].notna().all(axis=None)


def test_a_state_of_another_recipe_is_refused(world, tmp_path):
    state = tmp_path / "state.pt"
    Run(RECIPE, [world], state, torch.device("cpu"))._save()
    longer = dataclasses.replace(RECIPE, steps=9)
    assert Run(longer, [world], state, torch.device("cpu")).step == 0
    with pytest.raises(UserError, match=r"state\.pt.*worlds, points"):
        Run(dataclasses.replace(RECIPE, points=5), [world] * 2, state, torch.device("cpu"))


def test_scores_of_the_curve_are_those_of_the_masks(world, monkeypatch):
    """Masks equal to the truth have IoU 1 in every class of size that occurs, and shifted points would not."""
    labels = world.labels(world.subpart[0, 0])[2]

    def decode(model, features, fine, points):
        values = labels[tuple(np.floor(points.numpy()[:, ::-1] / 2).astype(int).T)]
        masks = torch.from_numpy(labels == values[:, None, None]).float() - 0.5
        return masks[:, None].expand(-1, 4, -1, -1), None, None, None

    found = {name: [] for name in ("0.1-1 %", "1-5 %", "> 5 %", "thin")}
    monkeypatch.setattr(sam2_curve, "decode", decode)
    monkeypatch.setattr(sam2_curve, "encode_image", lambda *_: ([torch.zeros(1, 1, 1, 1)] * 3, None, None))
    model = SimpleNamespace(
        image_size=128, no_mem_embed=torch.zeros(1), parameters=lambda: iter([torch.zeros(1)])
    )
    sam2_curve._score_points(model, np.asarray(world.rgb[0, 0]), labels, np.random.default_rng(0), found)
    assert found["> 5 %"] == [1.0] * 4 and not found["0.1-1 %"] and not found["1-5 %"]


def test_all_image_sides_are_trained_on(world, tmp_path):
    recipe = dataclasses.replace(RECIPE, sides=(256, 128), pictures=2)
    run = Run(recipe, [world], tmp_path / "state.pt", torch.device("cpu"))
    sampled = [run._sample(step)[0] for step in range(0, 24, 2)]
    counts = {clips[0].pictures.shape[1]: len(clips) for clips in sampled}
    assert counts == {256: 2, 128: 8}
    for clips in sampled:
        assert {clip.pictures.shape[1] for clip in clips} == {clips[0].pictures.shape[1]}


def test_a_corrupt_training_state_is_reported(tmp_path):
    path = tmp_path / "state.pt"
    assert read_state(path, torch.device("cpu")) is None
    path.write_bytes(b"rubbish")
    with pytest.raises(UserError, match=r"state\.pt"):
        read_state(path, torch.device("cpu"))
    path.unlink()
    save_state(path, step=5)
    assert read_state(path, torch.device("cpu")) == {"step": 5}


@pytest.mark.parametrize("recipe", [Recipe(steps=1, seed=0), recipe_from_weights(1, 0, 4e-4)])
def test_the_configured_side_lies_between_the_trained_ones(recipe):
    sides = recipe.sides
    assert min(sides) <= OmegaConf.load(train_sam2.CONFIG).model.image_size <= max(sides)


def test_training_from_weights_has_clips_from_the_first_steps_on():
    recipe = recipe_from_weights(1000, 0, 4e-4)
    assert [step for step in range(32) if recipe.on_clips(step)] == [15, 31]
