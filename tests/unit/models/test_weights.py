"""Checkpoints are read without running their code; invalid ones are reported."""

import io
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2
from egosplat.models.weights import NothingDrawn, load_weights, read_tensors

TENSORS = {"weight": torch.arange(6.0).reshape(2, 3), "bias": torch.tensor([0.5, -0.25])}


def save(tensors: dict, path: Path) -> None:
    (save_file if path.suffix == ".safetensors" else torch.save)(tensors, path)


@pytest.mark.parametrize("name", ["m.pt", "m.pth", "m.bin", "m.safetensors"])
def test_saved_weights_are_read_back(tmp_path, name):
    save(TENSORS, tmp_path / name)
    read = read_tensors(tmp_path / name)
    assert read.keys() == TENSORS.keys()
    assert all(torch.equal(read[key], TENSORS[key]) for key in TENSORS)


def test_tensors_of_safetensors_outlive_their_file(tmp_path):
    """A mapped file would end the process where somebody writes it anew, at addresses that torch never gives."""
    path = tmp_path / "m.safetensors"
    save_file(TENSORS, path)
    read = read_tensors(path)
    path.write_bytes(bytes(path.stat().st_size))
    assert all(torch.equal(read[key], TENSORS[key]) for key in TENSORS)
    assert not any(value.data_ptr() % 64 for value in read.values())


@pytest.mark.parametrize(
    "wrapped",
    [
        {"model": TENSORS},
        {"state_dict": TENSORS, "epoch": 3},
        {"module." + name: value for name, value in TENSORS.items()},
        {"state_dict": {"module." + name: value for name, value in TENSORS.items()}},
    ],
)
def test_wrapped_state_dicts_are_unwrapped(tmp_path, wrapped):
    torch.save(wrapped, tmp_path / "m.pt")
    assert read_tensors(tmp_path / "m.pt").keys() == TENSORS.keys()


class Harmful:
    """Calls ``open`` when it is unpickled."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return (open, (str(self.marker), "w"))


def test_code_in_a_checkpoint_is_rejected_and_not_run(tmp_path):
    torch.save({"model": TENSORS, "more": Harmful(tmp_path / "ran")}, tmp_path / "m.pt")
    with pytest.raises(UserError, match="m.pt.*code") as caught:
        read_tensors(tmp_path / "m.pt")
    assert not (tmp_path / "ran").exists()
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize("name", ["m.pt", "m.safetensors"])
@pytest.mark.parametrize(
    "content", [b"", bytes(50), b"<html>404 not found</html>", b"version https://git-lfs"]
)
def test_garbage_is_reported_in_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=f"{name}: .*checkpoint.* {len(content)} bytes") as caught:
        read_tensors(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["m.pt", "m.safetensors"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_truncated_checkpoint_is_reported(tmp_path, name, share):
    save({"weight": torch.zeros(100, 100)}, tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(UserError, match=f"{name}: .*checkpoint"):
        read_tensors(tmp_path / name)


LIMITED = """
import resource, sys
from pathlib import Path
import safetensors.torch
from egosplat.models.weights import read_tensors
taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + 100_000_000, resource.RLIM_INFINITY))
for name in sys.argv[1:]:
    try:
        read_tensors(Path(name))
    except Exception as error:
        print(type(error).__name__, " ".join(str(error).split()))
"""


@pytest.mark.slow
def test_a_lack_of_memory_is_not_reported_as_damage(tmp_path):
    files = [tmp_path / "m.pt", tmp_path / "m.safetensors"]
    for file in files:
        save({"a": torch.zeros(50_000_000)}, file)
    done = subprocess.run([sys.executable, "-c", LIMITED, *files], capture_output=True, text=True, check=True)
    pickled, tensors = done.stdout.splitlines()
    for said in (pickled, tensors):
        assert re.match("(MemoryError|RuntimeError) .*allocate memory", said), done


def test_random_bytes_never_crash_the_reader(tmp_path):
    random = np.random.default_rng(0)
    stream = io.BytesIO()
    torch.save(TENSORS, stream, _use_new_zipfile_serialization=False)
    path = tmp_path / "m.pt"
    for _ in range(100):
        content = bytearray(stream.getvalue())
        for place in random.integers(0, len(content), 8):
            content[place] = random.integers(256)
        path.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                read_tensors(path)
            except UserError as error:
                assert "m.pt" in str(error)


@pytest.mark.parametrize(
    "content",
    [[1, 2], {}, {"a": 3}, {"model": {"a": {"b": torch.ones(1)}}}, {1: torch.ones(1)}, torch.ones(3)],
)
def test_a_file_without_tensors_or_of_another_kind_is_reported(tmp_path, content):
    torch.save(content, tmp_path / "m.pt")
    with pytest.raises(UserError, match="m.pt.*tensors"):
        read_tensors(tmp_path / "m.pt")
    with pytest.raises(UserError, match=r"m.onnx: .*\.safetensors, \.pt"):
        read_tensors((tmp_path / "m.pt").rename(tmp_path / "m.onnx"))


def test_half_precision_is_converted_and_weights_of_the_module_s_dtype_are_not_copied():
    module = nn.Linear(3, 2).requires_grad_(False)
    load_weights(module, {name: value.half() for name, value in TENSORS.items()}, Path("m.pt"), SAM2)
    assert module.weight.dtype == torch.float32
    assert torch.equal(module.weight, TENSORS["weight"]) and torch.equal(module.bias, TENSORS["bias"])
    load_weights(module, TENSORS, Path("m.pt"), SAM2)
    assert module.weight.data_ptr() == TENSORS["weight"].data_ptr()
    assert isinstance(module.weight, nn.Parameter) and not module.weight.requires_grad


@pytest.mark.parametrize(
    "layer, sizes",
    [(nn.Linear, (3, 2)), (nn.Conv2d, (3, 2, 3)), (nn.Embedding, (3, 2)), (nn.MultiheadAttention, (4, 2))],
)
def test_layers_are_built_without_random_numbers(layer, sizes):
    before = torch.get_rng_state()
    with NothingDrawn():
        built = layer(*sizes).state_dict()
    assert torch.equal(torch.get_rng_state(), before)
    drawn = layer(*sizes).state_dict()
    assert {name: value.shape for name, value in built.items()} == {k: v.shape for k, v in drawn.items()}


def test_another_architecture_is_reported_with_counts_and_examples(tmp_path):
    module = nn.Sequential(nn.Linear(3, 2), nn.Linear(3, 2))
    given = {"0.weight": torch.zeros(4, 3), "0.bias": torch.zeros(2), "head": torch.zeros(1)}
    with pytest.raises(UserError) as caught:
        load_weights(module, given, tmp_path / "m.pt", SAM2)
    first, second = str(caught.value).splitlines()
    assert "m.pt: has another architecture than models.sam2_config" in first
    assert "2 of 4 tensors missing (as 1.weight)" in first
    assert "1 unexpected (as head)" in first
    assert "1 of another shape (as 0.weight, 4x3 instead of 2x3)" in first
    assert "models.sam2_config" in second and "models.sam2_checkpoint" in second


@pytest.mark.parametrize("value", [[float("nan"), 0], [0, -float("inf")], [1, 2]])
def test_weights_without_meaning_are_refused(tmp_path, value):
    with pytest.raises(UserError, match="m.pt: tensor bias holds"):
        load_weights(nn.Linear(3, 2), TENSORS | {"bias": torch.tensor(value)}, tmp_path / "m.pt", SAM2)
