"""Checkpoints are found or reported missing, and their hash follows their content."""

import hashlib
import os
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.models import checkpoints
from egosplat.models.checkpoints import CLIP, SAM2, content_hash, find_checkpoint, model_hash, model_hashes
from egosplat.pipeline.config import resolve

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"


def keys_of(sam2: Path, clip: Path) -> dict[str, str]:
    return {
        "sam2_config": str(sam2 / "sam2.yaml"),
        "sam2_checkpoint": str(sam2 / "model.safetensors"),
        "clip_model": str(clip),
        "clip_checkpoint": str(clip / "open_clip_model.safetensors"),
    }


@pytest.mark.parametrize("model", [SAM2, CLIP])
def test_a_missing_checkpoint_names_its_key(tmp_path, model):
    with pytest.raises(UserError) as caught:
        find_checkpoint(model, str(tmp_path / "none.pt"))
    first, second = str(caught.value).splitlines()
    assert first == f"models.{model.checkpoint_key}: there is no file {tmp_path / 'none.pt'}."
    assert "egosplat models download" in second and f"models: {{{model.checkpoint_key}: PATH}}" in second


def test_a_missing_small_checkpoint_is_reported(tmp_path, monkeypatch):
    gone = checkpoints.ModelSpec(**vars(SAM2) | {"small": tmp_path / "model.safetensors"})
    with pytest.raises(UserError, match="SAM2.*model.safetensors"):
        find_checkpoint(gone, "small")
    gone.small.touch()
    assert find_checkpoint(gone, "small") == gone.small


def test_a_tilde_in_a_path_is_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "m.pt").touch()
    assert find_checkpoint(SAM2, "~/m.pt") == tmp_path / "m.pt"


def test_the_hash_is_sha256_and_follows_the_content(tmp_path):
    path = tmp_path / "m.pt"
    path.write_bytes(b"one")
    assert content_hash(path) == hashlib.sha256(b"one").hexdigest()
    path.write_bytes(b"two")
    os.utime(path, ns=(1, 1))
    assert content_hash(path) == hashlib.sha256(b"two").hexdigest()


def test_a_file_is_read_once(tmp_path, monkeypatch):
    path = tmp_path / "m.pt"
    path.write_bytes(b"once")
    first = content_hash(path)
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("read again"))
    assert content_hash(path) == first


def test_the_hash_covers_every_file_of_a_model(tiny_sam2, tiny_clip, tmp_path):
    keys = keys_of(tiny_sam2, tiny_clip)
    own = tmp_path / "own.yaml"
    own.write_text((tiny_sam2 / "sam2.yaml").read_text() + "\n# a comment\n")
    assert model_hash(SAM2, keys) == model_hash(SAM2, keys | {"sam2_config": str(own)})
    own.write_text((tiny_sam2 / "sam2.yaml").read_text() + "\nanother: 1\n")
    assert model_hash(SAM2, keys) != model_hash(SAM2, keys | {"sam2_config": str(own)})
    assert model_hash(SAM2, keys) != model_hash(SAM2, keys | {"sam2_checkpoint": str(own)})
    before = model_hash(CLIP, keys)
    vocabulary = tiny_clip / "bpe.txt.gz"
    content = vocabulary.read_bytes()
    try:
        vocabulary.write_bytes(content + b"\0")
        assert model_hash(CLIP, keys) != before
    finally:
        vocabulary.write_bytes(content)


def test_a_missing_model_does_not_affect_others(tiny_sam2, tiny_clip):
    keys = keys_of(tiny_sam2, tiny_clip) | {"clip_checkpoint": "/nowhere/m.bin"}
    hashes = model_hashes({"models": keys})
    assert hashes == {"sam2_checkpoint": model_hash(SAM2, keys), "clip_checkpoint": "missing"}


def test_the_paper_preset_can_be_hashed_without_its_checkpoints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = resolve({"preset": "paper"}, PRESETS)
    assert model_hashes(config) == {"sam2_checkpoint": "missing", "clip_checkpoint": "missing"}
