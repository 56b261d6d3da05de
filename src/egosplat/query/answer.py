"""Answers to queries in one view, from its rendered codes."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.codes.decoder import Decoder
from egosplat.geometry import Array, Camera
from egosplat.query.maps import Found, find_in_maps
from egosplat.query.options import QueryOptions
from egosplat.query.position import pixel_position
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.smoothing import Map, Mask
from egosplat.query.text import Texts

_MAPS_AT_ONCE = 2**27
"""Numbers of relevancy that are held at a time, 512 MiB in float32; more queries are decoded for in turn."""


@dataclass(frozen=True, eq=False)
class View:
    """One view of the codes, at the resolution (h, w) in which they were rendered.

    Attributes:
        codes: (L, h, w, C) float32 codes of full weight at each level.
        coverage: (L, h, w) float32 in 0..1: how much of a pixel is covered by something with a code.
        depth: (h, w) float32 expected camera z [m]; 0 where nothing is.
        camera: of the picture of the answers, (H, W); its image is the codes', resized.
        camera_to_world: (4, 4) float64.
        valid: (H, W) bool pixels of the picture that show the scene, or None for all; there is no answer elsewhere.
    """

    codes: Tensor
    coverage: Tensor
    depth: Tensor
    camera: Camera
    camera_to_world: Array
    valid: Mask | None


@dataclass(frozen=True, eq=False)
class Answer:
    """What one query finds in one view of (H, W) pixels.

    Where nothing is seen at any level there is no answer: score 0, no candidates, an empty mask, and None.

    Attributes:
        phrase: the query's words.
        score: largest smoothed relevancy, 0..1; above 0.5 it fits better than every canonical phrase.
        level: index of the level that this is found at.
        candidates: (K, 2) int64 column and row of all pixels that have it.
        pixel: column and row of the one among them that is nearest to their middle.
        position: (3,) float64 place in the world that this pixel's centre shows [m]; None also without depth.
        relevancy: (H, W) float32 at ``level``, not smoothed; 0 where nothing is seen.
        mask_level: index of the level that the mask is made at.
        mask: (H, W) bool.
    """

    phrase: str
    score: float
    level: int | None
    candidates: NDArray[np.int64]
    pixel: tuple[int, int] | None
    position: Array | None
    relevancy: Map
    mask_level: int | None
    mask: Mask


def answer_from_codes(view: View, decoder: Decoder, texts: Texts, options: QueryOptions) -> Iterator[Answer]:
    """Answer queries in order, one at a time, because each answer holds maps of the picture's size.

    Args:
        view: what is asked.
        decoder: of its codes.
        texts: the queries.
        options: how they are answered; ``canonical`` is in the texts, ``resolution`` in the view already.

    Raises:
        ValueError: a code is not finite, or shapes do not belong together.
    """
    _check(view)
    height, width = view.camera.height, view.camera.width
    valid = np.ones((height, width), bool) if view.valid is None else view.valid
    seen = _seen(view, valid, options.min_coverage)
    there = torch.from_numpy(seen).to(view.codes.device)
    for part in texts.in_parts(max(1, _MAPS_AT_ONCE // seen.size)):
        maps = relevancy_maps(view.codes, there, decoder, part, options.temperature)
        for phrase, small in zip(part.phrases, maps, strict=True):
            levels = np.where(seen, small.cpu().numpy(), np.float32(np.nan))
            yield _answer(phrase, find_in_maps(levels, valid, options), view)


def _answer(phrase: str, found: Found | None, view: View) -> Answer:
    if found is None:
        nothing = np.zeros((view.camera.height, view.camera.width), np.float32)
        return Answer(phrase, 0.0, None, np.zeros((0, 2), np.int64), None, None, nothing, None, nothing > 0)
    location = found.location
    return Answer(
        phrase=phrase,
        score=location.score,
        level=location.level,
        candidates=location.candidates,
        pixel=location.pixel,
        position=pixel_position(view.camera, view.camera_to_world, location.pixel, view.depth.cpu().numpy()),
        relevancy=found.relevancy,
        mask_level=found.segmentation.level,
        mask=found.segmentation.mask,
    )


def _check(view: View) -> None:
    codes, size = tuple(view.codes.shape), (view.camera.height, view.camera.width)
    wanted = {"coverage": (view.coverage, codes[:3]), "depth": (view.depth, codes[1:3])}
    if view.valid is not None:
        wanted["valid"] = (view.valid, size)
    for name, (array, shape) in wanted.items():
        if len(codes) != 4 or tuple(array.shape) != shape:
            raise ValueError(f"{name} {tuple(array.shape)} does not belong to codes {codes}, picture {size}")


def _seen(view: View, valid: Mask, min_coverage: float) -> Mask:
    """(L, h, w) bool: what the codes' view shows of the scene."""
    height, width = view.depth.shape
    inside = cv2.resize(valid.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0
    return (view.coverage > min_coverage).cpu().numpy() & inside
