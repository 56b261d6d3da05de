"""Tiny SAM2 and OpenCLIP models with random weights, and a machine without other machines."""

import copy
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from omegaconf import OmegaConf

from egosplat.models.checkpoints import SMALL_SAM2
from egosplat.models.sam2_loader import build_predictor
from tests.support.tiny_clip import DESCRIPTION, save_half

NECK = {"d_model": 16, "backbone_channel_list": [64, 32, 16, 8], "fpn_top_down_levels": [2, 3]}
SIZES = {
    "image_size": 256,
    "num_maskmem": 3,
    "image_encoder.trunk": {"embed_dim": 8, "stages": [1, 1, 2, 1], "global_att_blocks": [3]},
    "image_encoder.neck": NECK,
    "image_encoder.neck.position_encoding": {"num_pos_feats": 16},
    "memory_attention": {"d_model": 16, "num_layers": 1},
    "memory_attention.layer": {"d_model": 16, "dim_feedforward": 16},
    "memory_attention.layer.self_attention": {"embedding_dim": 16, "feat_sizes": [16, 16]},
    "memory_attention.layer.cross_attention": {"embedding_dim": 16, "feat_sizes": [16, 16], "kv_in_dim": 8},
    "memory_encoder": {"in_dim": 16, "out_dim": 8},
    "memory_encoder.position_encoding": {"num_pos_feats": 8},
    "memory_encoder.mask_downsampler": {"embed_dim": 16},
    "memory_encoder.fuser": {"num_layers": 1},
    "memory_encoder.fuser.layer": {"dim": 16},
}
"""How the tiny SAM2 differs from the small one that egosplat ships."""


def tiny_model() -> dict[str, Any]:
    """The configuration of a tiny SAM2 for images of 256 pixels."""
    tree = OmegaConf.load(SMALL_SAM2)
    for path, changes in SIZES.items():
        OmegaConf.update(tree.model, path, changes)
    return OmegaConf.to_container(tree)


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test if it tries to reach another machine."""

    def only_here(function: Callable[..., Any], host_of: Callable[..., str]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            if host_of(*arguments) != "127.0.0.1":
                pytest.fail("a connection was attempted")
            return function(*arguments, **named)

        return call

    for owner, name, host_of in (
        (socket.socket, "connect", lambda _, address: address[0]),
        (socket, "create_connection", lambda address, *_: address[0]),
        (socket, "getaddrinfo", lambda host, *_: host),
    ):
        monkeypatch.setattr(owner, name, only_here(getattr(owner, name), host_of))


@pytest.fixture
def model_tree() -> dict[str, Any]:
    """The configuration of a tiny SAM2 for images of 256 pixels; a copy that tests may change."""
    return tiny_model()


@pytest.fixture
def description() -> dict[str, Any]:
    """The configuration of a tiny OpenCLIP model; a copy that tests may change."""
    return copy.deepcopy(DESCRIPTION)


@pytest.fixture(scope="session")
def tiny_sam2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``sam2.yaml`` and its checkpoint ``model.safetensors``, in half precision."""
    folder = tmp_path_factory.mktemp("sam2")
    (folder / "sam2.yaml").write_text(yaml.safe_dump(tiny_model()))
    torch.manual_seed(0)
    save_half(build_predictor(folder / "sam2.yaml"), folder / "model.safetensors")
    return folder


@pytest.fixture
def image() -> np.ndarray:
    """An image of odd size, (77, 101, 3) uint8."""
    return np.random.default_rng(0).integers(0, 256, (77, 101, 3), dtype=np.uint8)
