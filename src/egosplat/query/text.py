"""Encode queries with OpenCLIP."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FEATURES, TILES
from egosplat.errors import UserError
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip

# Start and end of every text.
_SPECIAL_TOKENS = 2

# Unicode categories of characters that nobody sees: control characters, and those of format, such as zero-width ones.
_UNSEEN = ("Cc", "Cf")

# Unicode category of surrogates: Python decodes bytes that are not UTF-8 to them.
_NO_TEXT = "Cs"


@dataclass(frozen=True, eq=False)
class Texts:
    """Features of Q queries and of K canonical phrases.

    Attributes:
        queries: (Q, D) float32 of unit norm.
        canonical: (K, D) float32 of unit norm, K at least 1.
    """

    phrases: tuple[str, ...]
    queries: Tensor
    canonical: Tensor

    def of(self, phrases: Sequence[str]) -> "Texts":
        """Select queries, in the order of the given phrases."""
        rows = [self.phrases.index(phrase) for phrase in phrases]
        return Texts(tuple(phrases), self.queries[rows], self.canonical)

    def in_batches(self, size: int) -> Iterator["Texts"]:
        """Split the queries into batches of at most ``size``, in order."""
        for begin in range(0, len(self.phrases), size):
            batch = slice(begin, begin + size)
            yield Texts(self.phrases[batch], self.queries[batch], self.canonical)


def encode_texts(clip: OpenClip, phrases: Sequence[str], canonical: Sequence[str]) -> Texts:
    """Encode queries and canonical phrases as they are, without a prompt template (docs/method.md#query-text).

    Args:
        phrases: Q queries; may be empty.
        canonical: K phrases, at least one.

    Raises:
        UserError: see ``encode_phrases``.
    """
    return Texts(tuple(phrases), encode_phrases(clip, phrases), encode_phrases(clip, canonical))


def encode_phrases(clip: OpenClip, phrases: Sequence[str]) -> Tensor:
    """Encode P phrases.

    Returns:
        (P, D) float32 of unit norm, on the CPU; (0, 0) without phrases.

    Raises:
        UserError: a phrase is blank, not text, or too long for the model, or its feature is zero or not finite.
    """
    if not phrases:
        return torch.zeros(0, 0)
    for phrase in phrases:
        _check_letters(phrase)
    tokens = clip.tokenizer(list(map(clean_phrase, phrases)))
    for row in tokens[:, -1].nonzero()[:, 0].tolist():
        # Zeros fill a shorter text.
        _check_length(clip, phrases[row])
    with clip.compute.inference():
        features = clip.model.encode_text(tokens.to(clip.compute.device)).float().cpu().numpy()
    for phrase, good in zip(phrases, usable(features), strict=True):
        if not good:
            raise UserError(f"query {phrase!r}: models.clip_checkpoint gives a zero or non-finite feature")
    return torch.from_numpy(unit(features)).float()


def clean_phrase(phrase: str) -> str:
    """A phrase without characters that nobody sees, and with single spaces."""
    seen = (one for one in phrase if one.isspace() or unicodedata.category(one) not in _UNSEEN)
    return " ".join("".join(seen).split())


def untaught_words(clip: OpenClip, phrase: str) -> list[str]:
    """Words of a phrase that the model was not trained on, in order; all that it reads if that holds no word.

    A model that lists no vocabulary knows every word, which has letters or digits of any script.
    """
    # What the model was not trained on has a feature of arbitrary direction, so its relevancy is meaningless.
    read = clip.tokenizer.clean_fn(clean_phrase(phrase)).lower()
    words = re.findall(r"[^\W_]+", read)
    if not words:
        return [read]
    return [] if clip.words is None else [word for word in words if word not in clip.words]


def explain_untaught(untaught: Sequence[str]) -> str | None:
    """Say that words of ``untaught_words`` have no answer; None without any."""
    if not untaught:
        return None
    if not any(map(str.isalnum, "".join(untaught))):
        return "The query holds no word."
    words = [f'"{word}"' for word in dict.fromkeys(untaught)]
    return f"The models here were never taught the word{'s' if words[1:] else ''} {', '.join(words)}."


def _check_letters(phrase: str) -> None:
    if not clean_phrase(phrase):
        raise UserError("query: is blank; describe the object in a few words")
    if any(unicodedata.category(letter) == _NO_TEXT for letter in phrase):
        raise UserError(f"query {phrase[:80]!r}: is not UTF-8; describe the object in words")


def _check_length(clip: OpenClip, phrase: str) -> None:
    tokens, limit = (
        len(clip.tokenizer.encode(clean_phrase(phrase))),
        clip.tokenizer.context_length - _SPECIAL_TOKENS,
    )
    if tokens > limit:
        raise UserError(f"query {phrase[:80]!r}: has {tokens} tokens, the model reads {limit}; shorten it")


def open_encoded(features: Path | None, tiles: Path | None) -> Artifact:
    """Open what OpenCLIP encoded for a scene's codes: its features, or the tiles that its method learns from.

    Raises:
        UserError: neither is given, or it cannot be opened.
    """
    if features is not None:
        return open_artifact(features, FEATURES)
    if tiles is None:
        raise UserError("needs the features artifact, or the tiles: give --features or --tiles")
    return open_artifact(tiles, TILES)


def encoded_of(language: Artifact) -> str:
    """Name of the artifact that codes were learnt from: ``features``, or ``tiles`` by methods without masks."""
    return "tiles" if "tiles.zarr" in language.provenance["inputs"] else "features"
