"""Checkpoints and files of architectures are found or reported missing, their hash follows their content, and a notice is given exactly if
small ones are used on a real recording."""

import hashlib
import os
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from egosplat.errors import UserError
from egosplat.models.checkpoints import (
    CLIP,
    SAM2,
    clip_config_files,
    clip_folder,
    content_hash,
    find_checkpoint,
    model_hash,
    model_hashes,
    sam2_config_file,
    sam2_configs,
)
from egosplat.models.suitability import configured_checkpoints, notice, notice_of_artifacts
from egosplat.pipeline.config import resolve
from tests.support import PRESETS


def keys_of(sam2: Path, clip: Path) -> dict[str, str]:
    return {
        "sam2_config": str(sam2 / "sam2.yaml"),
        "sam2_checkpoint": str(sam2 / "model.safetensors"),
        "clip_model": str(clip),
        "clip_checkpoint": str(clip / "open_clip_model.safetensors"),
    }


@pytest.mark.parametrize("model", [SAM2, CLIP])
def test_a_missing_checkpoint_names_its_key_and_a_tilde_is_the_home_folder(tmp_path, monkeypatch, model):
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(UserError) as caught:
        find_checkpoint(model, "~/none.pt")
    first, second = str(caught.value).splitlines()
    assert first == f"models.{model.checkpoint_key}: there is no file {tmp_path / 'none.pt'}."
    assert "egosplat models --all" in second and f"models: {{{model.checkpoint_key}: PATH}}" in second
    (tmp_path / "none.pt").touch()
    assert find_checkpoint(model, "~/none.pt") == tmp_path / "none.pt"
    gone = replace(model, bundled={"small": (bundled := tmp_path / "model.safetensors")})
    with pytest.raises(UserError, match=f"{model.name}.*model.safetensors"):
        find_checkpoint(gone, "small")
    bundled.touch()
    assert find_checkpoint(gone, "small") == bundled


def test_the_hash_is_sha256_and_a_file_is_read_once(tmp_path, monkeypatch):
    path = tmp_path / "m.pt"
    path.write_bytes(b"one")
    assert content_hash(path) == hashlib.sha256(b"one").hexdigest()
    path.write_bytes(b"two")
    os.utime(path, ns=(1, 1))
    second = content_hash(path)
    assert second == hashlib.sha256(b"two").hexdigest()
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("read again"))
    assert content_hash(path) == second


def test_the_hash_covers_every_file_of_a_model(tiny_sam2, tiny_clip, tmp_path):
    keys = keys_of(tiny_sam2, tiny_clip)
    own = tmp_path / "own.yaml"
    own.write_text((tiny_sam2 / "sam2.yaml").read_text() + "\nanother: 1\n")
    described = shutil.copytree(tiny_clip, tmp_path / "clip")
    (described / "bpe.txt.gz").write_bytes(b"others")
    for model, key, path in ((SAM2, "config", own), (SAM2, "checkpoint", own), (CLIP, "model", described)):
        changed = keys | {f"{'clip' if model is CLIP else 'sam2'}_{key}": str(path)}
        assert model_hash(model, changed) != model_hash(model, keys)


def test_a_missing_model_does_not_affect_others(tiny_sam2, tiny_clip, folder):
    keys = keys_of(tiny_sam2, tiny_clip) | {"clip_checkpoint": "/nowhere/m.bin"}
    hashes = model_hashes({"models": keys})
    assert hashes == {"sam2_checkpoint": model_hash(SAM2, keys), "clip_checkpoint": "missing"}
    paper = resolve({"preset": "paper"}, PRESETS)
    assert model_hashes(paper) == {"sam2_checkpoint": "missing", "clip_checkpoint": "missing"}


@pytest.mark.parametrize("folder", ["", "sam2.1/", "configs/sam2.1/"])
@pytest.mark.parametrize("suffix", ["", ".yaml"])
def test_sam2_s_own_architectures_have_several_spellings(folder, suffix):
    file = sam2_config_file(f"{folder}sam2.1_hiera_b+{suffix}")
    assert file.is_file() and file.parts[-3:] == ("configs", "sam2.1", "sam2.1_hiera_b+.yaml")
    kinds = [f"hiera_{size}" for size in ("t", "s", "b+", "l")]
    assert {*sam2_configs()} == {f"{version}_{kind}" for version in ("sam2", "sam2.1") for kind in kinds}
    assert sam2_config_file(str(file)) == file


@pytest.mark.parametrize("prefix", ["", "local-dir:"])
def test_a_folder_describes_an_open_clip_model_and_its_own_names_need_none(tiny_clip, prefix):
    assert clip_folder(f"{prefix}{tiny_clip}") == tiny_clip
    files = [tiny_clip / "open_clip_config.json", tiny_clip / "bpe.txt.gz"]
    assert clip_config_files(f"{prefix}{tiny_clip}") == files
    assert clip_folder("ViT-B-16") is None and clip_config_files("ViT-B-16") == []


@pytest.mark.parametrize(
    "find, given, message",
    [
        (sam2_config_file, "sam2.1_hiera_b", r"models.sam2_config = .*sam2.1_hiera_b\+"),
        (sam2_config_file, "/nowhere/sam2.1_hiera_b+.yaml", r"models.sam2_config = .*sam2.1_hiera_b\+"),
        (sam2_config_file, "configs/sam2/sam2.1_hiera_b+", r"models.sam2_config = .*sam2.1_hiera_b\+"),
        (clip_folder, "ViT-B-61", "neither a folder nor known .did you mean 'ViT-B-"),
        (clip_folder, "hf-hub:laion/CLIP-ViT-B-16", "stages download nothing"),
        (clip_folder, "/nowhere", "models.clip_model = '/nowhere' is neither a folder nor known"),
        (clip_folder, str(PRESETS), "models.clip_model: .*open_clip_config.json"),
    ],
)
def test_an_unknown_architecture_is_reported(find, given, message):
    with pytest.raises(UserError, match=message):
        find(given)


BOTH = {"sam2_checkpoint": "small", "clip_checkpoint": "small"}
HALF = {"sam2_checkpoint": "small", "clip_checkpoint": "clip.bin"}
WORDS = {"sam2_checkpoint": "small", "clip_checkpoint": "photos"}


def artifact(origin: str, models: dict[str, str], **facts):
    """A stand-in for an artifact with an origin, and the checkpoints of its provenance."""
    made = {"options": models, "models": dict.fromkeys(models, "c0de")}
    return SimpleNamespace(origin=origin, provenance=made, facts=facts)


@pytest.mark.parametrize(
    "origin, checkpoints, said",
    [
        ("real", BOTH, ["apartments only", "sam2_checkpoint", "clip_checkpoint", "to light"]),
        ("real", HALF, ["models.sam2_checkpoint", "egosplat models download --config models.set=light"]),
        # Words for photographs know the classes of ImageNet; few suit the dark pictures of Aria glasses.
        ("real", WORDS, ["the set photos", "ImageNet", "dark", "to light"]),
        ("real", {"sam2_checkpoint": "sam2.pt", "clip_checkpoint": "clip.bin"}, []),
        ("real", {}, []),
        ("synthetic", BOTH, []),
        ("synthetic", WORDS, []),
    ],
)
def test_models_that_do_not_suit_the_recording_are_reported_with_what_to_do(origin, checkpoints, said):
    told = notice(origin, checkpoints)
    assert (told is None) == (not said) and "\n" not in (told or "")
    assert all(words in (told or "") for words in said)
    assert checkpoints is not HALF or "clip" not in told


def test_artifacts_are_reported_by_their_provenance():
    segments = artifact("real", {"sam2_checkpoint": "small"})
    frames = artifact("real", {})
    assert notice_of_artifacts([frames]) is None
    assert notice_of_artifacts([frames, segments]) == notice("real", {"sam2_checkpoint": "small"})
    features = artifact("real", {}, clip={"checkpoint": "small"})
    assert notice_of_artifacts([frames, segments, features]) == notice("real", BOTH)
    assert notice_of_artifacts([artifact("synthetic", {}), segments]) is None


def test_sam2_counts_only_where_it_segments():
    config = {"models": BOTH, "segments": {"segmenter": "sam2"}}
    assert configured_checkpoints(config) == BOTH
    config["segments"]["segmenter"] = "classical"
    assert configured_checkpoints(config) == {"clip_checkpoint": "small"}
