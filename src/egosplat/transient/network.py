"""The network H: the probability that a pixel is transient (docs/method.md#network).

As in EgoLifter: a U-Net on the features of MobileNetV3-Small at half width.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from egosplat.errors import UserError
from egosplat.models.checkpoints import how_to_fetch
from egosplat.models.weights import read_tensors
from egosplat.models.without_compiler import without_compiler

with without_compiler():
    import timm

# timm's name, and the default widths of segmentation_models_pytorch's U-Net.
ENCODER = "mobilenetv3_small_050"
DECODER_WIDTHS = (256, 128, 64, 32, 16)

# Mean and standard deviation of ImageNet, sRGB in [0, 1].
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)

# Tensors of a classifier checkpoint that the feature encoder lacks.
_CLASSIFIER = ("conv_head.", "norm_head.", "classifier.")


class TransientNet(nn.Module):
    """H, initialized from torch's global random generator."""

    _mean: Tensor
    _std: Tensor

    def __init__(self, input_size: int, sideways: bool) -> None:
        """Build the layers with random weights, for a square input of ``input_size`` [px], a multiple of 32.
        ``sideways`` images lie on their side, as from Aria's sensor, and are turned upright for the
        network."""
        super().__init__()
        self._input_size = input_size
        self._sideways = sideways
        self.encoder: Any = timm.create_model(ENCODER, pretrained=False, features_only=True)
        self.decoder = Decoder(self.encoder.feature_info.channels(), DECODER_WIDTHS)
        self.head = nn.Conv2d(DECODER_WIDTHS[-1], 1, kernel_size=1)
        # Buffers follow the network to its device; not persistent, because they are constants.
        for name, values in (("mean", _MEAN), ("std", _STD)):
            self.register_buffer(f"_{name}", torch.tensor(values)[:, None, None], persistent=False)

    def forward(self, picture: Tensor, height: int, width: int) -> Tensor:
        """Return the (height, width) float32 probability that a pixel is transient. ``picture`` is (H, W, 3)
        float32 sRGB, clamped to [0, 1]; a value that is not finite counts as 0."""
        batch = picture.nan_to_num(0.0, 0.0, 0.0).clamp(0.0, 1.0).permute(2, 0, 1)[None]
        batch = _resized((batch - self._mean) / self._std, self._input_size, self._input_size)
        # ImageNet's weights know upright images, and the scene stands on the floor (docs/method.md#upright).
        if self._sideways:
            batch = batch.rot90(-1, (2, 3))
        logits = self.head(self.decoder(self.encoder(batch)))
        if self._sideways:
            logits = logits.rot90(1, (2, 3))
        # EgoLifter's order: resize before the sigmoid.
        return _resized(logits, height, width).sigmoid()[0, 0]


class Decoder(nn.Module):
    """Upsample features from coarse to fine, and concatenate the encoder's features at each size."""

    def __init__(self, features: Sequence[int], widths: Sequence[int]) -> None:
        """Build one block per size, from the channels of the features, finest first, and its own, coarsest first."""
        super().__init__()
        *skips, coarsest = features
        inputs, joined = [coarsest, *widths[:-1]], [*reversed(skips), 0]
        sizes = zip(inputs, joined, widths, strict=True)
        self.blocks = nn.ModuleList(_block(below + skip, width) for below, skip, width in sizes)

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        """Map features (1, C_i, S / 2^i, S / 2^i), finest (i = 1) first, to (1, widths[-1], S, S)."""
        *skips, x = features
        for block, skip in zip(self.blocks, [*reversed(skips), None], strict=True):
            x = functional.interpolate(x, scale_factor=2.0, mode="nearest")
            x = block(x if skip is None else torch.cat([x, skip], dim=1))
        return x


def make_network(input_size: int, sideways: bool, encoder_weights: Path | None, seed: int) -> TransientNet:
    """Create H from ``seed``, with encoder weights of a file if given (UserError: missing, damaged or unfit)."""
    # Leaves the global random generator untouched.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        net = TransientNet(input_size, sideways)
    if encoder_weights is not None:
        _load_encoder(net.encoder, encoder_weights)
    return net


def _load_encoder(encoder: nn.Module, path: Path) -> None:
    if not path.is_file():
        told = f"transient.encoder_weights: no file {path}, for weights of timm's {ENCODER}"
        raise UserError(f"{told}.\nSet the key to null. {how_to_fetch(path)}")
    # Published weights are of the whole classifier.
    given = {name: t for name, t in read_tensors(path).items() if not name.startswith(_CLASSIFIER)}
    try:
        encoder.load_state_dict(given)
    except RuntimeError:
        told = (
            f"{path}: is not of timm's {ENCODER}; take its weights, or set transient.encoder_weights to null"
        )
        raise UserError(told) from None


def _block(channels: int, width: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for inputs in (channels, width):
        convolution = nn.Conv2d(inputs, width, kernel_size=3, padding=1, bias=False)
        nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
        layers += [convolution, nn.BatchNorm2d(width), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


def _resized(batch: Tensor, height: int, width: int) -> Tensor:
    return functional.interpolate(batch, (height, width), mode="bilinear", align_corners=False)
