"""Training resumes exactly, kinds of crops have their shares, and short texts are encoded as the model encodes them."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file

from training.open_clip import main
from training.small_models.attributes import COLORS
from training.small_models.clip_model import (
    WEIGHTS,
    build,
    encode_short_text,
    save_weights,
    write_description,
)
from training.small_models.clip_training import Schedule, Trainer, draw_masked
from training.small_models.crops import KINDS, Crops, sampling_weights
from training.small_models.patches import PATCH_PX

SCHEDULE = Schedule(steps=4, batch=16, captions=4, warmup=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the model."""
    made = tmp_path_factory.mktemp("model")
    write_description(made)
    return made


def crops_of(
    names: NDArray[np.str_], rng: np.random.Generator, patches: NDArray[np.uint8], surface: str
) -> Crops:
    """Crops of wholes, masked from their objects, that differ in name, patch and color."""
    count, numbers = len(names), np.arange(len(names), dtype=np.int32)
    zeros, colors = np.zeros(count, dtype=np.int32), rng.dirichlet(np.ones(len(COLORS)), count)
    about = (colors.astype(np.float32), np.array([surface] * count), numbers + 100, numbers + 10)
    shares = np.ones(count, dtype=np.float32)
    return Crops(patches, zeros, names, zeros + 2, *about, shares, zeros, numbers, numbers)


def make_crops() -> Crops:
    """A few crops of noise, the same every time."""
    rng = np.random.default_rng(0)
    names = np.array(["cup", "couch", "cup/handle", "floor"] * 10)
    patches = rng.integers(0, 256, (len(names), PATCH_PX, PATCH_PX, 4), dtype=np.uint8)
    patches[..., 3] = 255
    level = np.where(np.char.find(names, "/") < 0, 2, 1).astype(np.int32)
    kind = (np.arange(len(names)) % 5 == 0).astype(np.int32)
    return replace(crops_of(names, rng, patches, "striped cloth:1.00"), kind=kind, level=level)


def make_trainer(folder: Path) -> Trainer:
    """A trainer of the same model every time."""
    torch.manual_seed(0)
    model, tokenizer = build(folder)
    return Trainer(model, tokenizer, make_crops(), SCHEDULE, 0, "cpu")


def test_kinds_and_levels_have_their_shares_of_the_sampling() -> None:
    kind = np.array([0] * 90 + [1] * 10, dtype=np.int32)
    names = np.array(["cup"] * 60 + ["cup/handle"] * 30 + ["floor"] * 9 + ["cup"])
    weight = sampling_weights(names, kind, tiles=0.25)
    np.testing.assert_allclose(weight[90:].sum(), 0.25)
    np.testing.assert_allclose(weight[:60].sum(), 0.75 * 1.2 / 2.2)
    assert weight[99] > weight[90], "a rare name is drawn more often"
    assert not sampling_weights(names, kind, tiles=0.0)[90:].any()
    kind[:20] = kind[60:70] = KINDS.index("segment")
    weight = sampling_weights(names, kind, tiles=0.25, segments=0.5)
    np.testing.assert_allclose([weight[:20].sum(), weight[60:70].sum()], [0.5 * 1.2 / 2.2, 0.5 / 2.2])
    np.testing.assert_allclose([weight[90:].sum(), weight.sum()], [0.25, 1])


def test_squares_are_a_fraction_of_the_batch_and_tiles_are_never_masked() -> None:
    rng = np.random.default_rng(0)
    tile = np.arange(20_000) % 4 == 0
    masked = draw_masked(tile, Schedule(steps=1, squares=0.3, tiles=0.25), rng)
    assert not masked[tile].any()
    assert abs(masked.mean() - 0.45) < 0.02
    assert draw_masked(tile, Schedule(steps=1, squares=0.0, tiles=0.25), rng)[~tile].all()


def test_a_resumed_training_ends_like_an_uninterrupted_one(folder: Path, tmp_path: Path) -> None:
    whole = make_trainer(folder)
    before = whole.model.visual.conv1.weight.detach().clone()
    whole.run(tmp_path / "whole.pt", 4)
    make_trainer(folder).run(tmp_path / "state.pt", 2)
    resumed = make_trainer(folder)
    resumed.run(tmp_path / "state.pt", 4)
    assert resumed.step == 4
    assert not torch.equal(before, whole.model.visual.conv1.weight)
    for name, value in whole.model.state_dict().items():
        torch.testing.assert_close(resumed.model.state_dict()[name], value, atol=1e-6, rtol=1e-5, msg=name)


def test_training_can_start_from_another_model(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crops, start, output = make_crops(), tmp_path / "start", tmp_path / "model"
    (tmp_path / "crops").mkdir()
    np.savez(tmp_path / "crops" / "1.npz", **{one.name: getattr(crops, one.name) for one in fields(Crops)})
    start.mkdir()
    torch.manual_seed(5)
    model, _ = build(folder)
    save_weights(model, start / WEIGHTS)
    arguments = [tmp_path / "crops", output, "--start", start, "--steps", 1, "--squares", 0.3, "--tiles", 0.2]
    monkeypatch.setattr("sys.argv", ["open_clip", *map(str, arguments), "--rate", "0"])
    main()
    # At a rate of 0 the weights stay as they were.
    for name in ("visual.conv1.weight", "token_embedding.weight"):
        torch.testing.assert_close(load_file(output / WEIGHTS)[name], load_file(start / WEIGHTS)[name])


def test_short_texts_are_encoded_as_padded_ones(folder: Path) -> None:
    model, tokenizer = build(folder)
    tokens = tokenizer(["cup", "a photo of the red mug", "tv stand"])
    with torch.no_grad():
        expected = model.encode_text(tokens, normalize=True)
        torch.testing.assert_close(encode_short_text(model, tokens), expected, atol=1e-5, rtol=0)
