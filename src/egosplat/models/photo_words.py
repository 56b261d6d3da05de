"""Crops and phrases as distributions over ImageNet's classes: real words for photographs, from Python packages alone.

A crop is the distribution p that EfficientNet-Lite2 gives, a phrase the softmax q of its similarity to the classes' names
(docs/models.md#words-for-photographs). Square roots of distributions have unit norm, and the inner product of two is their overlap.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.utils import fuse_conv_bn_eval

from egosplat.compute import choose_compute
from egosplat.models.checkpoints import CLIP, find_checkpoint
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.models.configs import PHOTOS, SENTENCES
from egosplat.models.sentences import SentenceEncoder, WordPieces, read_sentence_encoder
from egosplat.models.weights import NothingDrawn, load_weights, read_tensors
from egosplat.models.without_compiler import without_compiler

# What stands before a phrase and the name of a class; OpenAI's first template.
PROMPT = "a photo of a"

# Temperature of the softmax over the cosines of a phrase with the names of the classes.
TEMPERATURE = 0.1

# The input of EfficientNet-Lite2, whose values are from -1 to 1.
INPUT = Preprocessing((260, 260), (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), "bicubic")

# Names of classes that are encoded at a time.
_BATCH = 64

# Pictures that a processor encodes at a time. The features of more exceed 32 MB, which malloc asks of the system anew for
# each layer: half of the time went into page faults.
_PICTURES = 4


class PhotoWords(nn.Module):
    """The two encoders, with the methods of an OpenCLIP model.

    Args:
        classifier: gives logits of C classes.
        names: of the C classes.
    """

    def __init__(
        self, classifier: nn.Module, sentences: SentenceEncoder, tokenizer: WordPieces, names: Sequence[str]
    ) -> None:
        super().__init__()
        self.classifier, self.sentences = classifier, sentences
        self._tokenizer, self._names = tokenizer, names
        self._classes: Tensor | None = None

    def encode_image(self, pictures: Tensor) -> Tensor:
        """(N, C) float32 square roots of the classes' probabilities, of (N, 3, H, W) pictures."""
        # With the channels of a pixel side by side, convolutions take two thirds of the time on a processor.
        pictures = pictures.to(memory_format=torch.channels_last)
        parts = pictures.split(_PICTURES) if pictures.device.type == "cpu" else [pictures]
        return torch.cat([self.classifier(part).float().softmax(dim=-1).sqrt() for part in parts])

    def encode_text(self, tokens: Tensor) -> Tensor:
        """(N, C) float32 square roots of the classes' shares in (N, T) tokens of phrases."""
        cosines = self.sentences(tokens).float() @ self._class_features(tokens.device).T
        return (cosines / TEMPERATURE).softmax(dim=-1).sqrt()

    def _class_features(self, device: torch.device) -> Tensor:
        """(C, F) float32 features of the classes' names, made when a phrase first needs them."""
        if self._classes is None:
            parts = [self._names[begin : begin + _BATCH] for begin in range(0, len(self._names), _BATCH)]
            self._classes = torch.cat(
                [self.sentences(self._tokenizer(part).to(device)).float() for part in parts]
            )
        return self._classes


def load_photo_words(device: str, precision: str) -> OpenClip:
    """Build the model from the two packages; UserError if one is missing or damaged, or the device is missing."""
    compute, weights = choose_compute(device, precision), find_checkpoint(CLIP, PHOTOS)
    with without_compiler():
        from open_clip.zero_shot_metadata import IMAGENET_CLASSNAMES
    tokenizer, sentences = read_sentence_encoder(SENTENCES.find(), PROMPT)
    model = PhotoWords(read_classifier(weights), sentences, tokenizer, IMAGENET_CLASSNAMES)
    model = model.to(compute.device).eval().requires_grad_(False)
    return OpenClip(model, INPUT, tokenizer, compute, tokenizer)


def read_classifier(path: Path) -> nn.Module:
    """timm's EfficientNet-Lite2 with the package's weights, in the same order under other names; UserError if damaged."""
    with without_compiler():
        import timm

    with NothingDrawn():
        model = timm.create_model("tf_efficientnet_lite2", pretrained=False)
    given = read_tensors(path)
    names = model.state_dict().keys()
    load_weights(model, dict(zip(names, given.values(), strict=False)), path, CLIP)
    return fold_norms(model.eval()).to(memory_format=torch.channels_last)


def fold_norms(model: nn.Module) -> nn.Module:
    """Multiply each normalization into the convolution before it: a sixth less time, and the same up to rounding."""
    for part in [*model.modules()]:
        for (name, first), (second, norm) in pairwise([*part.named_children()]):
            if isinstance(first, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                setattr(part, name, fuse_conv_bn_eval(first, norm))
                setattr(part, second, getattr(norm, "act", nn.Identity()))
    return model
