"""OpenCLIP's features of phrases."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.codes.vectors import unit, usable
from egosplat.errors import UserError
from egosplat.models.open_clip_loader import OpenClip

_SPECIAL_TOKENS = 2
"""Start and end, which stand around every text."""


_NO_TEXT = ("Cc", "Cs")
"""Unicode's categories of control characters, and of what stands for bytes that are no UTF-8."""


@dataclass(frozen=True, eq=False)
class Texts:
    """Q queries, and the K canonical phrases that they are compared with.

    Attributes:
        phrases: the queries' words.
        queries: (Q, D) float32 of unit norm.
        canonical: (K, D) float32 of unit norm, K at least 1.
    """

    phrases: tuple[str, ...]
    queries: Tensor
    canonical: Tensor

    def of(self, phrases: Sequence[str]) -> "Texts":
        """Some of the queries, in the order of these phrases."""
        rows = [self.phrases.index(phrase) for phrase in phrases]
        return Texts(tuple(phrases), self.queries[rows], self.canonical)

    def in_parts(self, size: int) -> Iterator["Texts"]:
        """The queries, at most ``size`` at a time, in order."""
        for begin in range(0, len(self.phrases), size):
            part = slice(begin, begin + size)
            yield Texts(self.phrases[part], self.queries[part], self.canonical)


def encode_texts(clip: OpenClip, phrases: Sequence[str], canonical: Sequence[str]) -> Texts:
    """Encode queries and canonical phrases word for word, without a template (docs/method.md#query-text).

    Args:
        clip: the model that made the features which are asked.
        phrases: Q queries; may be none.
        canonical: K phrases, at least one.

    Raises:
        UserError: see ``encode_phrases``.
    """
    return Texts(tuple(phrases), encode_phrases(clip, phrases), encode_phrases(clip, canonical))


def encode_phrases(clip: OpenClip, phrases: Sequence[str]) -> Tensor:
    """The features of phrases.

    Returns:
        (P, D) float32 of unit norm, on the CPU; (0, 0) of no phrase.

    Raises:
        UserError: a phrase is blank, no text, or longer than the model reads, or the model makes no direction of it.
    """
    if not phrases:
        return torch.zeros(0, 0)
    for phrase in phrases:
        _check(clip, phrase)
    with clip.compute.inference():
        tokens = clip.tokenizer(list(phrases)).to(clip.compute.device)
        features = clip.model.encode_text(tokens).float().cpu().numpy()
    for phrase, good in zip(phrases, usable(features), strict=True):
        if not good:
            raise UserError(f"query {phrase!r}: the model of models.clip_checkpoint makes no direction of it")
    return torch.from_numpy(unit(features)).float()


def untaught_words(clip: OpenClip, phrase: str) -> list[str]:
    """Words of a phrase that the model was not trained on, in order; none where the model lists no words.

    An untrained word has an arbitrary direction, so its relevancy says nothing.
    """
    if clip.words is None:
        return []
    return [word for word in re.findall(r"[^\W_]+", phrase.lower()) if word not in clip.words]


def _check(clip: OpenClip, phrase: str) -> None:
    if not phrase.strip():
        raise UserError("query: is blank; say in a few words what to look for")
    if any(unicodedata.category(letter) in _NO_TEXT for letter in phrase):
        raise UserError(
            f"query {phrase[:80]!r}: holds control characters, or is not in UTF-8; say it in words"
        )
    tokens, limit = len(clip.tokenizer.encode(phrase)), clip.tokenizer.context_length - _SPECIAL_TOKENS
    if tokens > limit:
        raise UserError(f"query {phrase[:80]!r}: has {tokens} tokens, the model reads {limit}; shorten it")
