"""Names, paths and ``small`` are resolved to the files of an architecture."""

import pytest

from egosplat.errors import UserError
from egosplat.models.checkpoints import clip_config_files, clip_folder, sam2_config_file, sam2_configs


@pytest.mark.parametrize(
    "config",
    [
        "sam2.1_hiera_b+",
        "sam2.1_hiera_b+.yaml",
        "sam2.1/sam2.1_hiera_b+",
        "configs/sam2.1/sam2.1_hiera_b+.yaml",
    ],
)
def test_sam2_s_own_architectures_have_several_spellings(config):
    file = sam2_config_file(config)
    assert file.is_file() and file.parts[-3:] == ("configs", "sam2.1", "sam2.1_hiera_b+.yaml")


def test_all_of_sam2_s_own_architectures_are_known():
    kinds = ("t", "s", "b+", "l")
    expected = {f"{version}_hiera_{kind}" for version in ("sam2", "sam2.1") for kind in kinds}
    assert set(sam2_configs()) == expected


def test_a_path_is_used_as_it_is(tiny_sam2):
    assert sam2_config_file(str(tiny_sam2 / "sam2.yaml")) == tiny_sam2 / "sam2.yaml"


@pytest.mark.parametrize(
    "config", ["sam2.1_hiera_b", "/nowhere/sam2.1_hiera_b+.yaml", "configs/sam2/sam2.1_hiera_b+"]
)
def test_an_unknown_sam2_lists_the_known_ones(config):
    with pytest.raises(UserError, match=r"models.sam2_config = .*sam2.1_hiera_b\+"):
        sam2_config_file(config)


def test_open_clip_s_own_names_need_no_folder():
    assert clip_folder("ViT-B-16") is None and clip_config_files("ViT-B-16") == []


@pytest.mark.parametrize("prefix", ["", "local-dir:"])
def test_a_folder_describes_an_open_clip_model(tiny_clip, prefix):
    assert clip_folder(f"{prefix}{tiny_clip}") == tiny_clip
    assert clip_config_files(f"{prefix}{tiny_clip}") == [
        tiny_clip / "open_clip_config.json",
        tiny_clip / "bpe.txt.gz",
    ]


@pytest.mark.parametrize(
    "model, message",
    [
        ("ViT-B-61", "neither a folder nor known .did you mean 'ViT-B-"),
        ("hf-hub:laion/CLIP-ViT-B-16", "stages download nothing"),
        ("/nowhere", "models.clip_model = '/nowhere' is neither a folder nor known"),
    ],
)
def test_an_unknown_open_clip_is_reported(model, message):
    with pytest.raises(UserError, match=message):
        clip_folder(model)


def test_a_folder_without_description_is_reported(tmp_path):
    with pytest.raises(UserError, match="models.clip_model: .*open_clip_config.json"):
        clip_folder(str(tmp_path))
