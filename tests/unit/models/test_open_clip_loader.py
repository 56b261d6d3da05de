"""OpenCLIP is loaded from a folder or by name, with its vocabulary; invalid files are reported."""

import gzip
import hashlib
import json
import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from egosplat.errors import UserError
from egosplat.models.checkpoints import SMALL_CLIP
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.models.open_clip_loader import load_open_clip, read_description
from egosplat.pipeline.config import merge
from egosplat.query.text import encode_phrases


def load(folder: Path, precision: str = "float32") -> OpenClip:
    return load_open_clip(str(folder), str(folder / "open_clip_model.safetensors"), "cpu", precision)


@pytest.fixture
def folder(tiny_clip, tmp_path) -> Path:
    """A private copy of the tiny model's folder."""
    return Path(shutil.copytree(tiny_clip, tmp_path / "model"))


def test_half_precision_is_loaded_into_float32(tiny_clip):
    saved, loaded = load_file(tiny_clip / "open_clip_model.safetensors"), load(tiny_clip).model.state_dict()
    assert loaded.keys() == saved.keys()
    assert all(torch.equal(loaded[name], saved[name].float()) for name in saved)


def test_no_tensor_is_left_as_it_was_before_loading(tiny_clip):
    torch.manual_seed(0)
    first = load(tiny_clip).model
    torch.manual_seed(1)
    second = load(tiny_clip).model
    for of in (nn.Module.parameters, nn.Module.buffers):
        assert all(torch.equal(a, b) for a, b in zip(of(first), of(second), strict=True))


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_pictures_and_texts_become_features(tiny_clip, precision):
    clip = load(tiny_clip, precision)
    height, width = clip.preprocessing.image_size
    with clip.compute.inference():
        images = clip.model.encode_image(torch.rand(2, 3, height, width))
        texts = clip.model.encode_text(clip.tokenizer(["a chair", "the red chair by the door", "x"]))
    assert images.shape == (2, 8) and texts.shape == (3, 8)
    assert images.isfinite().all() and texts.isfinite().all()


def test_preprocessing_comes_from_the_folder_or_open_clip(tiny_clip):
    own = (0.26862954, 0.26130258, 0.27577711)
    assert load(tiny_clip).preprocessing == Preprocessing((32, 32), (0.5, 0.4, 0.3), own, "bilinear")


def test_the_reduced_vocabulary_is_used(tiny_clip):
    tokenizer = load(tiny_clip).tokenizer
    assert tokenizer.vocab_size == 512 + 4 + 2 and tokenizer.context_length == 6
    assert len(tokenizer.encode("chair")) == 1 and len(tokenizer.encode("door")) == 4
    assert tokenizer(["chair chair chair chair chair chair"]).shape == (1, 6)


@pytest.mark.parametrize("model", ["roberta-ViT-B-32", "ViT-B-16-SigLIP"])
def test_a_model_that_needs_the_hub_is_rejected(model):
    with pytest.raises(UserError, match=f"models.clip_model = '{model}'"):
        read_description(model, None)


def part(name: str, **keys: object) -> dict:
    return {"model_cfg": {f"{name}_cfg": keys}}


BITS = bytearray(gzip.compress(bytes(range(256)) * 9, mtime=0))
BITS[12:40] = b"\xff" * 28
LARGE = '{"model_cfg": {"embed_dim": 3, "vision_cfg": "large", "text_cfg": {}}}'


@pytest.mark.parametrize(
    "edit, message",
    [
        # Keys of the description.
        (part("text", hf_tokenizer_name="bert-base-uncased"), "download"),
        (part("text", layers=2), "models.clip_model: 12 of"),
        (part("vision", timm_model_name="hf-hub:a/b"), "download"),
        (part("vision", timm_model_name="resnet18", timm_model_pretrained=True), "download"),
        ({"preprocess_cfg": {"mean": 3}}, "preprocess_cfg "),
        ({"preprocess_cfg": {"std": ["a", "b", "c"]}}, "preprocess_cfg "),
        ({"preprocess_cfg": {"interpolation": "magic"}}, "interpolation = 'magic'; .*bicubic, bilinear"),
        # The whole description.
        ("{", "open_clip_config.json: .* JSON"),
        ("[" * 5000, "open_clip_config.json: .* JSON .*nested"),
        *((text, "model_cfg with embed_dim") for text in ("[]", '{"model_cfg": {"embed_dim": 3}}', LARGE)),
        (LARGE.replace('"large"', "{}").replace("{}}}", "[]}}"), "model_cfg with embed_dim"),
        (LARGE.replace('"large"', '{"x": 1}'), "no OpenCLIP model"),
        # The vocabulary.
        (None, "49,408 .*518.* bpe.txt.gz"),
        *(
            (made, "bpe.txt.gz")
            for made in (b"rubbish", gzip.compress(b"a b" * 99, mtime=0)[:-12], bytes(BITS))
        ),
    ],
)
def test_a_fault_of_the_folder_is_reported(folder, description, edit, message):
    if isinstance(edit, dict):
        (folder / "open_clip_config.json").write_text(json.dumps(merge(description, edit)))
    elif isinstance(edit, str):
        (folder / "open_clip_config.json").write_text(edit)
    else:
        (folder / "bpe.txt.gz").unlink()
        if edit is not None:
            (folder / "bpe.txt.gz").write_bytes(edit)
    with pytest.raises(UserError, match=message) as caught:
        load(folder)
    assert not isinstance(edit, str) or "\n" not in str(caught.value)


NAMES = ("couch", "television", "step stool", "house plant")
NAMES += ("coffee table", "bowl", "refrigerator", "tea kettle")
SYNONYMS = ("settee", "telly", "footstool", "shrub", "cocktail table", "basin", "icebox", "teapot")


def test_synonyms_outside_of_the_captions_are_nearest_to_their_names() -> None:
    clip = load_open_clip("small", "small", "cpu", "float32")
    nearest = (encode_phrases(clip, SYNONYMS) @ encode_phrases(clip, NAMES).T).argmax(dim=-1)
    assert nearest.tolist() == [*range(len(NAMES))]


def test_the_model_card_names_the_checkpoint_s_hash() -> None:
    digest = hashlib.sha256((SMALL_CLIP / "open_clip_model.safetensors").read_bytes()).hexdigest()
    assert digest in (SMALL_CLIP / "MODEL_CARD.md").read_text()
