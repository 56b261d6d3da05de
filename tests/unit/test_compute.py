"""Device, number type and threads of computations."""

import pytest
import torch

from egosplat.compute import Compute, choose_compute, single_thread
from egosplat.errors import UserError

CPU, CUDA = torch.device("cpu"), torch.device("cuda")


@pytest.fixture
def machine(monkeypatch):
    """Pretend that there is a GPU or none, with bfloat16 or without."""

    def pretend(gpu: bool, bfloat16: bool = True) -> None:
        monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)
        monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda: bfloat16)

    return pretend


@pytest.mark.parametrize(
    "gpu, bfloat16, device, precision, expected",
    [
        (False, False, "auto", "auto", Compute(CPU, torch.float32)),
        (False, False, "cpu", "bfloat16", Compute(CPU, torch.bfloat16)),
        (True, True, "auto", "auto", Compute(CUDA, torch.bfloat16)),
        (True, True, "cpu", "auto", Compute(CPU, torch.float32)),
        (True, True, "cuda", "float32", Compute(CUDA, torch.float32)),
        (True, False, "auto", "auto", Compute(CUDA, torch.float32)),
    ],
)
def test_auto_takes_the_best_device_and_precision(machine, gpu, bfloat16, device, precision, expected):
    machine(gpu, bfloat16)
    assert choose_compute(device, precision) == expected


def test_an_unavailable_device_is_an_error(machine):
    machine(gpu=False)
    with pytest.raises(UserError, match="run.device = cuda"):
        choose_compute("cuda", "auto")
    machine(gpu=True, bfloat16=False)
    with pytest.raises(UserError, match="run.precision = bfloat16"):
        choose_compute("auto", "bfloat16")


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_products_are_of_the_number_type_and_nothing_is_recorded(dtype):
    layer = torch.nn.Linear(4, 3)
    with Compute(CPU, dtype).inference():
        result, rounds = layer(torch.ones(2, 4)), torch.backends.cudnn.allow_tf32
    assert result.dtype == dtype and not result.requires_grad and rounds == (dtype == torch.bfloat16)
    assert layer(torch.ones(2, 4)).dtype == torch.float32, "the setting outlived its block"


def test_single_thread_restores_the_number_of_threads(with_threads):
    def fail() -> int:
        with pytest.raises(RuntimeError, match="inside"), single_thread():
            assert torch.get_num_threads() == 1
            raise RuntimeError("inside")
        return torch.get_num_threads()

    assert with_threads(2, fail) == 2
