"""Which device trains Gaussians."""

import importlib.util

import pytest
import torch

from egosplat.errors import UserError
from egosplat.gaussians import device
from egosplat.gaussians.device import training_device


@pytest.fixture
def broken_gsplat(monkeypatch):
    """A machine with a GPU and an installed gsplat that cannot compile itself."""

    def fails() -> None:
        raise UserError("backend cuda: gsplat found no CUDA toolkit")

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    monkeypatch.setattr(device, "load_gsplat", fails)


def test_auto_takes_a_gpu_that_renders_or_says_why_not(broken_gsplat, capsys, monkeypatch):
    """An environment may have gsplat for the tests, and no nvcc."""
    assert training_device("auto").type == "cpu"
    assert "gsplat found no CUDA toolkit" in capsys.readouterr().err
    monkeypatch.setattr(device, "load_gsplat", lambda: object())
    assert training_device("auto").type == "cuda"


def test_only_a_gpu_that_is_asked_for_must_render(broken_gsplat):
    with pytest.raises(UserError, match="no CUDA toolkit"):
        training_device("cuda")
    assert training_device("cpu").type == training_device("reference").type == "cpu"
