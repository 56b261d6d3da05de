"""Tiny SAM2 and OpenCLIP models with random weights, and a machine without a network."""

import copy
import gzip
import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from safetensors.torch import save_file

from egosplat.models.open_clip_loader import build_model
from egosplat.models.sam2_loader import build_predictor

POSITIONS = {
    "_target_": "sam2.modeling.position_encoding.PositionEmbeddingSine",
    "num_pos_feats": 16,
    "normalize": True,
    "scale": None,
    "temperature": 10000,
}

ATTENTION = {
    "_target_": "sam2.modeling.sam.transformer.RoPEAttention",
    "rope_theta": 10000.0,
    "feat_sizes": [16, 16],
    "embedding_dim": 16,
    "num_heads": 1,
    "downsample_rate": 1,
    "dropout": 0.0,
}

MODEL = {
    "_target_": "sam2.modeling.sam2_base.SAM2Base",
    "image_encoder": {
        "_target_": "sam2.modeling.backbones.image_encoder.ImageEncoder",
        "scalp": 1,
        "trunk": {
            "_target_": "sam2.modeling.backbones.hieradet.Hiera",
            "embed_dim": 8,
            "num_heads": 1,
            "stages": [1, 1, 2, 1],
            "global_att_blocks": [3],
            "window_pos_embed_bkg_spatial_size": [8, 8],
            "window_spec": [8, 4, 8, 4],
        },
        "neck": {
            "_target_": "sam2.modeling.backbones.image_encoder.FpnNeck",
            "position_encoding": POSITIONS,
            "d_model": 16,
            "backbone_channel_list": [64, 32, 16, 8],
            "fpn_top_down_levels": [2, 3],
            "fpn_interp_model": "nearest",
        },
    },
    "memory_attention": {
        "_target_": "sam2.modeling.memory_attention.MemoryAttention",
        "d_model": 16,
        "pos_enc_at_input": True,
        "layer": {
            "_target_": "sam2.modeling.memory_attention.MemoryAttentionLayer",
            "activation": "relu",
            "dim_feedforward": 16,
            "dropout": 0.0,
            "pos_enc_at_attn": False,
            "self_attention": ATTENTION,
            "d_model": 16,
            "pos_enc_at_cross_attn_keys": True,
            "pos_enc_at_cross_attn_queries": False,
            "cross_attention": ATTENTION | {"rope_k_repeat": True, "kv_in_dim": 8},
        },
        "num_layers": 1,
    },
    "memory_encoder": {
        "_target_": "sam2.modeling.memory_encoder.MemoryEncoder",
        "in_dim": 16,
        "out_dim": 8,
        "position_encoding": POSITIONS | {"num_pos_feats": 8},
        "mask_downsampler": {
            "_target_": "sam2.modeling.memory_encoder.MaskDownSampler",
            "embed_dim": 16,
            "kernel_size": 3,
            "stride": 2,
            "padding": 1,
        },
        "fuser": {
            "_target_": "sam2.modeling.memory_encoder.Fuser",
            "layer": {
                "_target_": "sam2.modeling.memory_encoder.CXBlock",
                "dim": 16,
                "kernel_size": 7,
                "padding": 3,
                "layer_scale_init_value": 1e-6,
                "use_dwconv": True,
            },
            "num_layers": 1,
        },
    },
    "num_maskmem": 3,
    "image_size": 256,
    "sigmoid_scale_for_mem_enc": 20.0,
    "sigmoid_bias_for_mem_enc": -10.0,
    "use_mask_input_as_output_without_sam": True,
    "directly_add_no_mem_embed": True,
    "use_high_res_features_in_sam": True,
    "multimask_output_in_sam": True,
    "iou_prediction_use_sigmoid": True,
    "use_obj_ptrs_in_encoder": True,
    "add_tpos_enc_to_obj_ptrs": False,
    "only_obj_ptrs_in_the_past_for_eval": True,
    "pred_obj_scores": True,
    "pred_obj_scores_mlp": True,
    "fixed_no_obj_ptr": True,
    "use_mlp_for_obj_ptr_proj": True,
    "compile_image_encoder": False,
}

MERGES = ["c h", "ch a", "i r</w>", "cha ir</w>"]

DESCRIPTION = {
    "model_cfg": {
        "embed_dim": 8,
        "vision_cfg": {"image_size": 32, "layers": 1, "width": 64, "head_width": 32, "patch_size": 16},
        "text_cfg": {"context_length": 6, "vocab_size": 518, "width": 16, "heads": 2, "layers": 1},
    },
    "preprocess_cfg": {"mean": [0.5, 0.4, 0.3], "interpolation": "bilinear", "resize_mode": "squash"},
}


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test if it tries to reach another machine."""

    def refuse(*_: object, **__: object) -> None:
        pytest.fail("a connection was attempted")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "create_connection", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


@pytest.fixture
def model_tree() -> dict[str, Any]:
    """The configuration of a tiny SAM2 for images of 256 pixels; a copy that tests may change."""
    return {"model": copy.deepcopy(MODEL)}


@pytest.fixture
def description() -> dict[str, Any]:
    """The configuration of a tiny OpenCLIP model; a copy that tests may change."""
    return copy.deepcopy(DESCRIPTION)


@pytest.fixture(scope="session")
def tiny_sam2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``sam2.yaml`` and its checkpoint ``model.safetensors``, in half precision."""
    folder = tmp_path_factory.mktemp("sam2")
    (folder / "sam2.yaml").write_text(yaml.safe_dump({"model": MODEL}))
    torch.manual_seed(0)
    save_half(build_predictor(folder / "sam2.yaml"), folder / "model.safetensors")
    return folder


@pytest.fixture(scope="session")
def tiny_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with description, reduced vocabulary and checkpoint of an OpenCLIP model, in half precision."""
    folder = tmp_path_factory.mktemp("clip")
    (folder / "open_clip_config.json").write_text(json.dumps(DESCRIPTION))
    with gzip.open(folder / "bpe.txt.gz", "wt", encoding="utf-8") as file:
        file.write("\n".join(["#version: 0.2", *MERGES]))
    torch.manual_seed(0)
    save_half(build_model("tiny", DESCRIPTION["model_cfg"]), folder / "open_clip_model.safetensors")
    return folder


def save_half(module: torch.nn.Module, path: Path) -> None:
    save_file({name: value.half().contiguous() for name, value in module.state_dict().items()}, path)


@pytest.fixture
def image() -> np.ndarray:
    """An image of odd size, (77, 101, 3) uint8."""
    return np.random.default_rng(0).integers(0, 256, (77, 101, 3), dtype=np.uint8)
