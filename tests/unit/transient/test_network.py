"""The network H: EgoLifter's architecture, upright input, seeded weights, checked checkpoints."""

import pytest
import torch
from safetensors.torch import save_file

from egosplat.errors import UserError
from egosplat.transient.network import make_network

PICTURE = torch.rand(40, 56, 3, generator=torch.Generator().manual_seed(0))


def test_it_has_the_size_of_egolifters():
    net = make_network(64, False, None, 0)
    sizes = [sum(v.numel() for v in m.parameters()) for m in (net.encoder, net.decoder, net.head)]
    assert sizes == [272_288, 1_925_824, 17]


@torch.no_grad()
def test_a_sideways_picture_is_turned_clockwise_for_the_network():
    upright, sideways = (make_network(64, turned, None, 0).eval() for turned in (False, True))
    expected = upright(PICTURE.rot90(-1, (0, 1)), 56, 40).rot90(1, (0, 1))
    torch.testing.assert_close(sideways(PICTURE, 40, 56), expected, atol=1e-5, rtol=1e-5)
    assert not torch.allclose(sideways(PICTURE, 40, 56), upright(PICTURE, 40, 56), atol=1e-5)


@torch.no_grad()
def test_non_finite_pixels_become_black():
    net = make_network(64, False, None, 0).eval()
    broken, black = PICTURE.clone(), PICTURE.clone()
    broken[3, 4], broken[5, 6] = float("nan"), float("inf")
    black[3, 4], black[5, 6] = 0.0, 0.0
    assert torch.equal(net(broken, 40, 56), net(black, 40, 56))


def test_the_seed_decides_and_the_global_generator_is_left_alone():
    before = torch.get_rng_state()
    first, second, other = (make_network(64, False, None, seed).state_dict() for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), before)
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert not torch.equal(first["head.weight"], other["head.weight"])


def test_the_encoders_weights_come_from_a_classifiers_file(tmp_path):
    encoder = make_network(64, False, None, 5).encoder.state_dict()
    classifier = {"conv_head.weight": torch.zeros(2), "classifier.bias": torch.zeros(3)}
    save_file(encoder | classifier, tmp_path / "model.safetensors")
    net = make_network(64, False, tmp_path / "model.safetensors", 6)
    assert all(torch.equal(tensor, encoder[name]) for name, tensor in net.encoder.state_dict().items())


@pytest.mark.parametrize("change", ["absent", "missing", "reshaped"])
def test_weights_that_do_not_fit_are_rejected(tmp_path, change):
    path = tmp_path / "model.safetensors"
    tensors = make_network(64, False, None, 5).encoder.state_dict()
    if change == "missing":
        del tensors["conv_stem.weight"]
    if change == "reshaped":
        tensors["conv_stem.weight"] = torch.zeros(1)
    if change != "absent":
        save_file(tensors, path)
    with pytest.raises(UserError, match=r"(?s)model.safetensors.*mobilenetv3_small_050"):
        make_network(64, False, path, 0)
