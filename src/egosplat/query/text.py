"""Encode queries with OpenCLIP, and list words to try on a scene of a home."""

import difflib
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.func import functional_call

from egosplat.errors import UserError
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip
from egosplat.pipeline.strict_yaml import read_yaml
from egosplat.query.options import QueryOptions

# Unicode categories of characters that nobody sees: control characters, and those of format, such as zero-width ones; and
# that of surrogates, to which Python decodes bytes that are not UTF-8.
_UNSEEN, _NO_TEXT = ("Cc", "Cf"), "Cs"

# Relevancies held at a time, 512 MiB in float32. More queries are answered in batches.
AT_ONCE = 2**27

# Cosine from which a word means what the query means: "fridge" and "refrigerator", "lamp" and "desk lamp".
SYNONYM = 0.7

# Names of parts by the name of the whole: cushions fit a couch's Gaussians better than "couch", and are no other thing.
PARTS = {"bookcase": ("shelf",), "bookshelf": ("shelf",), "plant": ("flower", "pot")}
PARTS |= {seat: ("blanket", "cushion", "pillow") for seat in ("armchair", "bed", "chair", "couch")}

# Words of questions, and names of things.
WORDS = read_yaml(Path(__file__).with_name("words.yml"))
CARRIED, STAYING = WORDS["carried"], WORDS["staying"]


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
        return Texts(tuple(phrases), self.queries[[*map(self.phrases.index, phrases)]], self.canonical)

    def in_batches(self, numbers: int) -> Iterator["Texts"]:
        """Split the queries, in order, into batches of at most ``AT_ONCE`` relevancies; a query has this number of them."""
        size = max(1, AT_ONCE // max(1, numbers))
        for begin in range(0, len(self.phrases), size):
            end = begin + size
            yield Texts(self.phrases[begin:end], self.queries[begin:end], self.canonical)


def encode_texts(clip: OpenClip, phrases: Sequence[str], options: QueryOptions) -> Texts:
    """Encode queries and canonical phrases as they are, without a prompt template (docs/method.md#query-text)."""
    return Texts(tuple(phrases), encode_phrases(clip, phrases), _encode_again(clip, options.canonical))


def nearest_word(query: Texts, words: Texts) -> str | None:
    """The word that fits the one query best; None without words."""
    return words.phrases[int((words.queries @ query.queries[0]).argmax())] if words.phrases else None


def other_meanings(query: Texts, words: Texts, nearest: int = 0) -> Tensor:
    """(W,) bool, the words that name something else than the one query: no synonym, of which there are as many as are ``nearest`` at most,
    or any number for 0; no kind of it, nor what it is a kind of, as "table" for "side table", and no part of these."""
    phrase, fits = query.phrases[0].lower(), (words.queries @ query.queries[0]).tolist()
    least = max(SYNONYM, sorted(fits)[-nearest:][0]) if nearest else SYNONYM
    kinds = {word for word in words.phrases if is_kind(word, phrase) or is_kind(phrase, word)}
    alike = kinds | {phrase, *(word for word, fit in zip(words.phrases, fits, strict=True) if fit >= least)}
    alike |= name_parts(alike)
    return torch.tensor([word not in alike for word in words.phrases], dtype=torch.bool)


def is_kind(phrase: str, word: str) -> bool:
    """Whether a phrase is a word, or names a kind of it by its last words."""
    return f" {phrase}".endswith(f" {word}")


def name_parts(phrases: Iterable[str]) -> set[str]:
    """Names of the parts of things, see ``PARTS``."""
    wholes = [whole for whole in PARTS if any(is_kind(phrase, whole) for phrase in phrases)]
    return {part for whole in wholes for part in PARTS[whole]}


def encode_phrases(clip: OpenClip, phrases: Sequence[str], short: bool = False) -> Tensor:
    """Encode P phrases as (P, D) float32 of unit norm, on the CPU; (0, 0) without phrases; ``short`` ones faster, up to rounding (UserError:
    as ``refuse_phrase``, or a feature is zero or not finite)."""
    if not phrases:
        return torch.zeros(0, 0)
    for phrase in phrases:
        if refusal := refuse_phrase(clip, phrase):
            raise UserError(f"query {phrase[:80]!r}: {refusal}")
    tokens = clip.tokenizer([clean_phrase(phrase) for phrase in phrases])
    read = partial(_encode_short, clip.model) if short else clip.model.encode_text
    with clip.compute.inference():
        features = read(tokens.to(clip.compute.device)).float().cpu().numpy()
    for phrase, good in zip(phrases, usable(features), strict=True):
        if not good:
            raise UserError(f"query {phrase!r}: models.clip_checkpoint gives a zero or non-finite feature")
    return torch.from_numpy(unit(features)).float()


def _encode_short(model: Any, tokens: Tensor) -> Tensor:
    """Encode texts only as far as the longest of each hundred goes: in OpenAI's tower, nothing behind its end has a part in a text."""
    if not hasattr(model, "attn_mask"):
        return model.encode_text(tokens)
    encoded = []
    for part in tokens.split(100):
        end = int(part.argmax(dim=1).max()) + 1
        places, mask = model.positional_embedding[:end], model.attn_mask[:end, :end]
        cut = {"positional_embedding": places, "attn_mask": mask}
        encoded.append(functional_call(model, cut, kwargs={"text": part[:, :end]})[1])
    return torch.cat(encoded)


_encode_again = lru_cache(maxsize=2)(encode_phrases)


def refuse_phrase(clip: OpenClip, phrase: str) -> str | None:
    """Say why a phrase cannot be encoded: it is blank, not text, or too long for the model; None if it can."""
    if not clean_phrase(phrase):
        return "is blank; describe the object in a few words"
    if any(unicodedata.category(letter) == _NO_TEXT for letter in phrase):
        return "is not UTF-8; describe the object in words"
    limit = clip.tokenizer.context_length - 2  # without the start and the end of every text
    count = len(clip.tokenizer.encode(clean_phrase(phrase)))
    return f"has {count} tokens, the model reads {limit}; shorten it" if count > limit else None


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


def explain_untaught(clip: OpenClip, phrase: str) -> tuple[tuple[str, ...], str | None]:
    """The words of ``untaught_words``, and that they have no answer, with those that may be meant; None without any."""
    untaught = tuple(untaught_words(clip, phrase))
    if not any(map(str.isalnum, "".join(untaught))):
        return untaught, "The query has no word." if untaught else None
    words = [f'"{word}"' for word in dict.fromkeys(untaught)]
    why = f"The models here were never taught the word{'s' if words[1:] else ''} {', '.join(words)}."
    return untaught, " ".join(filter(None, (why, suggest(clip, phrase, untaught))))


def suggest(clip: OpenClip, phrase: str, untaught: Sequence[str]) -> str | None:
    """Ask whether the nearest words that the model was taught are meant; None where one has no near one."""
    known = [*words_to_try(clip), *(sorted(clip.words) if isinstance(clip.words, frozenset) else ())]
    meant = phrase.lower()
    for word in untaught:
        near = difflib.get_close_matches(word, known, n=1, cutoff=0.75)
        if not near:
            return None
        meant = re.sub(rf"\b{re.escape(word)}\b", near[0], meant)
    return f'Did you mean "{meant}"?'
