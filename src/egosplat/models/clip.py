"""A loaded OpenCLIP model, or one with its interface."""

from collections.abc import Container
from dataclasses import dataclass
from typing import Any

from egosplat.compute import Compute


@dataclass(frozen=True)
class Preprocessing:
    """The input of an OpenCLIP image encoder: height and width [px]; ``mean`` and ``std`` of R, G and B, for values from 0 to
    1; and the ``interpolation`` of resizing, ``bicubic`` or ``bilinear``."""

    image_size: tuple[int, int]
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    interpolation: str


@dataclass(frozen=True)
class OpenClip:
    """OpenCLIP with its weights.

    Attributes:
        model: a module; ``encode_image`` takes (N, 3, H, W) preprocessed images, ``encode_text`` (N, T) tokens; both return
            (N, D) features.
        preprocessing: input format of ``encode_image``.
        tokenizer: maps a list of N texts to (N, T) int64 tokens; with ``clean_fn``, ``encode`` and ``context_length``.
        compute: device and precision; run the model within ``compute.inference()``.
        words: lower-case words that the model knows; None if they are not known.
    """

    model: Any
    preprocessing: Preprocessing
    tokenizer: Any
    compute: Compute
    words: Container[str] | None = None
