"""Encode queries with OpenCLIP, and list words to try on a scene of a home."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip

# Unicode categories of characters that nobody sees: control characters, and those of format, such as zero-width ones; and
# that of surrogates, to which Python decodes bytes that are not UTF-8.
_UNSEEN, _NO_TEXT = ("Cc", "Cf"), "Cs"

# Relevancies held at a time, 512 MiB in float32. More queries are answered in batches.
AT_ONCE = 2**27


# Things of a home that people carry about. Synonyms are left out, here and below: they would share their scores.
CARRIED = re.split(
    r",\s+",
    """ball, basket, blanket, book, bottle, bowl, box, candle, chair, clock, coat, cup, cushion, cutting board, flower, kettle,
    keyboard, lamp, laptop, magazine, microwave, painting, pillow, plant, plate, pot, remote control, shoe, speaker, stool,
    teapot, tissue box, toaster, towel, toy, trash can, vase""",
)

# What stays, or carries.
STAYING = re.split(
    r",\s+",
    """armchair, bed, bookshelf, cabinet, carpet, ceiling, coffee table, couch, curtain, desk, dining table, door, dresser,
    floor, fridge, hand, mirror, nightstand, oven, person, rug, shelf, sink, stove, table, television, wall, window""",
)


def words_to_try(clip: OpenClip) -> tuple[str, ...]:
    """The things of a home that a model knows, in alphabetical order."""
    return tuple(sorted(phrase for phrase in CARRIED + STAYING if not untaught_words(clip, phrase)))


@dataclass(frozen=True, eq=False)
class Texts:
    """Q queries with their features, (Q, D) float32 of unit norm, and those of K canonical phrases, (K, D), K at least 1."""

    phrases: tuple[str, ...]
    queries: Tensor
    canonical: Tensor

    def of(self, phrases: Sequence[str]) -> "Texts":
        """Select queries, in the order of the given phrases."""
        rows = [self.phrases.index(phrase) for phrase in phrases]
        return Texts(tuple(phrases), self.queries[rows], self.canonical)

    def in_batches(self, numbers: int) -> Iterator["Texts"]:
        """Split the queries, in order, into batches of at most ``AT_ONCE`` relevancies; a query has this number of them."""
        size = max(1, AT_ONCE // max(1, numbers))
        for begin in range(0, len(self.phrases), size):
            batch = slice(begin, begin + size)
            yield Texts(self.phrases[batch], self.queries[batch], self.canonical)


def encode_texts(clip: OpenClip, phrases: Sequence[str], canonical: Sequence[str]) -> Texts:
    """Encode queries and canonical phrases as they are, without a prompt template (docs/method.md#query-text)."""
    return Texts(tuple(phrases), encode_phrases(clip, phrases), _encode_canonical(clip, tuple(canonical)))


def encode_phrases(clip: OpenClip, phrases: Sequence[str]) -> Tensor:
    """Encode P phrases as (P, D) float32 of unit norm, on the CPU; (0, 0) without phrases (UserError: a phrase is blank, not
    text, or too long for the model, or its feature is zero or not finite)."""
    if not phrases:
        return torch.zeros(0, 0)
    limit = clip.tokenizer.context_length - 2  # without the start and the end of every text
    for phrase in phrases:
        if not clean_phrase(phrase):
            raise UserError("query: is blank; describe the object in a few words")
        if any(unicodedata.category(letter) == _NO_TEXT for letter in phrase):
            raise UserError(f"query {phrase[:80]!r}: is not UTF-8; describe the object in words")
        if (count := len(clip.tokenizer.encode(clean_phrase(phrase)))) > limit:
            raise UserError(f"query {phrase[:80]!r}: has {count} tokens, the model reads {limit}; shorten it")
    tokens = clip.tokenizer([clean_phrase(phrase) for phrase in phrases])
    with clip.compute.inference():
        features = clip.model.encode_text(tokens.to(clip.compute.device)).float().cpu().numpy()
    for phrase, good in zip(phrases, usable(features), strict=True):
        if not good:
            raise UserError(f"query {phrase!r}: models.clip_checkpoint gives a zero or non-finite feature")
    return torch.from_numpy(unit(features)).float()


_encode_canonical = lru_cache(maxsize=1)(encode_phrases)


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
