"""The network H: how probable it is that a pixel shows something transient (docs/method.md#network).

EgoLifter's: a U-Net on MobileNetV3-Small's features at half its width.
"""

from collections.abc import Sequence
from pathlib import Path

import timm
import torch
from torch import Tensor, nn
from torch.nn import functional

from egosplat.errors import UserError
from egosplat.models.weights import read_tensors

ENCODER = "mobilenetv3_small_050"
DECODER_WIDTHS = (256, 128, 64, 32, 16)
STRIDE = 32
"""Pixels of the input that one of the encoder's last features stands for, a side."""

LEAST_SIDE = 64
"""At one stride, the encoder's last features would be one pixel, which batch norm cannot train on."""

_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of ImageNet's pictures, sRGB in [0, 1]."""

_CLASSIFIER = ("conv_head.", "norm_head.", "classifier.")
"""What a classifier's checkpoint has beyond the features."""


class TransientNet(nn.Module):
    """H. Random weights are torch's random generator's."""

    def __init__(self, input_size: int, sideways: bool) -> None:
        """``input_size``: side of the square that pictures are resized to [px], a multiple of 32.

        ``sideways``: pictures are as Aria's sensor takes them, and are turned upright before they are looked at.
        """
        super().__init__()
        self._input_size = input_size
        self._sideways = sideways
        self.encoder = timm.create_model(ENCODER, pretrained=False, features_only=True)
        self.decoder = Decoder(self.encoder.feature_info.channels(), DECODER_WIDTHS)
        self.head = nn.Conv2d(DECODER_WIDTHS[-1], 1, kernel_size=1)
        for name, values in (("mean", _MEAN), ("std", _STD)):
            self.register_buffer(f"_{name}", torch.tensor(values)[:, None, None], persistent=False)

    def forward(self, picture: Tensor, height: int, width: int) -> Tensor:
        """Probability that a pixel is of something transient.

        Args:
            picture: (H, W, 3) float32 sRGB, clamped to [0, 1]; what is not finite counts as 0.
            height, width: of the result, whatever the picture's.

        Returns:
            (height, width) float32 in [0, 1].
        """
        batch = picture.nan_to_num(0.0, 0.0, 0.0).clamp(0.0, 1.0).permute(2, 0, 1)[None]
        batch = _resized((batch - self._mean) / self._std, self._input_size, self._input_size)
        if self._sideways:
            batch = batch.rot90(-1, (2, 3))
        logits = self.head(self.decoder(self.encoder(batch)))
        if self._sideways:
            logits = logits.rot90(1, (2, 3))
        # EgoLifter's order: resized before the sigmoid.
        return _resized(logits, height, width).sigmoid()[0, 0]


class Decoder(nn.Module):
    """From the coarsest features to the finest, each time twice the size, joined with those of that size."""

    def __init__(self, features: Sequence[int], widths: Sequence[int]) -> None:
        """``features``: channels of the encoder's, finest first. ``widths``: of the blocks, coarsest first."""
        super().__init__()
        *skips, coarsest = features
        inputs = [coarsest, *widths[:-1]]
        joined = [*reversed(skips), 0]
        self.blocks = nn.ModuleList(
            _block(below + skip, width) for below, skip, width in zip(inputs, joined, widths, strict=True)
        )

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        """Features (1, C_i, S / 2^i, S / 2^i), finest (i = 1) first; the result is (1, widths[-1], S, S)."""
        *skips, x = features
        for block, skip in zip(self.blocks, [*reversed(skips), None], strict=True):
            x = functional.interpolate(x, scale_factor=2.0, mode="nearest")
            x = block(x if skip is None else torch.cat([x, skip], dim=1))
        return x


def make_network(input_size: int, sideways: bool, encoder_weights: Path | None, seed: int) -> TransientNet:
    """H with the encoder's weights of a file, or random ones; the decoder's are always random, from ``seed``.

    Raises:
        UserError: the size does not fit, or the file is absent, damaged or of another architecture.
    """
    if input_size % STRIDE or input_size < LEAST_SIDE:
        raise UserError(
            f"transient.input_size = {input_size}: must be a multiple of {STRIDE}, and at least {LEAST_SIDE}"
        )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        net = TransientNet(input_size, sideways)
    if encoder_weights is not None:
        _load_encoder(net.encoder, encoder_weights)
    return net


def _load_encoder(encoder: nn.Module, path: Path) -> None:
    if not path.is_file():
        raise UserError(
            f"transient.encoder_weights: there is no file {path}. Put timm's {ENCODER} there, or set the key to null"
        )
    given = {name: t for name, t in read_tensors(path).items() if not name.startswith(_CLASSIFIER)}
    try:
        encoder.load_state_dict(given)
    except RuntimeError:
        raise UserError(
            f"{path}: is of another architecture than timm's {ENCODER}. "
            "Give that one's weights as transient.encoder_weights, or set the key to null"
        ) from None


def _block(channels: int, width: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for inputs in (channels, width):
        convolution = nn.Conv2d(inputs, width, kernel_size=3, padding=1, bias=False)
        nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
        layers += [convolution, nn.BatchNorm2d(width), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


def _resized(batch: Tensor, height: int, width: int) -> Tensor:
    return functional.interpolate(batch, (height, width), mode="bilinear", align_corners=False)
