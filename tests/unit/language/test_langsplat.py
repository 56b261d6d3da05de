"""Training of codes converges, resumes identically, and reports divergence."""

import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import Targets, code_l1
from egosplat_rivals.langsplat import PlainCodes, codes_to_render
from egosplat_rivals.loop import train


@pytest.fixture
def views(prepared):
    return prepared()[0]


@pytest.fixture
def codes(views):
    """``codes(lr, normalize)``: new codes of two levels."""

    def make(lr: float = 0.05, normalize: bool = False) -> PlainCodes:
        return PlainCodes(views, (2, 3), LanguageOptions(iterations=60, lr=lr, seed=0), normalize)

    return make


def test_normalized_codes_leave_their_first_direction(wall, views, codes, checkpoint):
    """The first view shows the opposite of all others; Adam must not be stuck with its gradient, as it is from 0."""
    found = codes(0.01, normalize=True)
    targets, turned = views.targets, [True]

    def first_opposite(frame: int) -> Targets:
        given = targets(frame)
        sign = -1.0 if turned and turned.pop() else 1.0
        return Targets(sign * given.codes, given.known)

    object.__setattr__(views, "targets", first_opposite)
    train(found, len(views), 100, 0, checkpoint)
    left = (wall.means[:, 0] < -0.4) & (wall.means[:, :2].abs() < 0.9).all(dim=1)
    code = codes_to_render(found.code.detach(), True)[left, 1]
    wanted = torch.nn.functional.normalize(torch.tensor([1.0, 0.0, 0.5]), dim=0)
    assert float((code @ wanted).mean()) > 0.9


def test_the_loss_falls_and_a_run_resumes_to_the_same_codes(views, codes, checkpoint):
    whole, begun, rest = codes(), codes(), codes()
    curve = train(whole, len(views), 60, 0, checkpoint)
    iterations, losses = zip(*curve, strict=True)
    assert iterations == (10, 20, 30, 40, 50, 60) and losses[-1] < 0.2 * losses[0]
    saved = Checkpoint(checkpoint.file.parent.parent / "language.zarr", "key", 0.0)
    train(begun, len(views), 30, 0, saved)
    assert train(rest, len(views), 60, 0, saved) == curve and torch.equal(whole.code, rest.code)


def test_a_learning_rate_far_too_large_ends_training_and_its_checkpoint(views, codes, tmp_path):
    checkpoint = Checkpoint(tmp_path / "language.zarr", "key", 0.0)
    with pytest.raises(UserError, match=r"language\.lr"):
        train(codes(3e37), len(views), 40, 0, checkpoint)
    assert checkpoint.load() is None


def test_normalized_codes_have_unit_norm():
    code = torch.tensor([[[3.0, 4.0], [0.0, 0.0]]])
    assert codes_to_render(code, True).tolist() == [[[pytest.approx(0.6), pytest.approx(0.8)], [0.0, 0.0]]]
    assert codes_to_render(code, False) is code


def test_pixels_without_a_code_or_weight_count_in_the_denominator_alone():
    rendered = torch.tensor([1.0, 2.0, 3.0, 4.0]).reshape(1, 1, 2, 2)
    targets = Targets(torch.zeros(1, 1, 2, 2), torch.tensor([[[True, True], [False, True]]]))
    weight = torch.tensor([[1.0, 0.5], [1.0, 0.0]])
    assert float(code_l1(rendered, targets, weight)) == pytest.approx((1.0 + 1.0) / 4)
    assert float(code_l1(rendered, targets, None)) == pytest.approx((1.0 + 2.0 + 4.0) / 4)
