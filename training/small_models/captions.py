"""Captions of crops: phrases about names and looks, and which crops each caption is true of."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from training.small_models.attributes import COLORS
from training.small_models.concepts import (
    PARTS,
    WHOLES,
    Concept,
    kind_concepts,
    part_concepts,
    whole_concepts,
)
from training.small_models.crops import OWN_ARMS, Crops
from training.small_models.levels import LEVELS

# 1: true, 0: false, -1: undecided.
Truth = NDArray[np.int8]

PATTERNS: dict[str, tuple[str, ...]] = {
    "plain": ("plain",),
    "striped": ("striped", "stripy"),
    "checked": ("checked", "checkered"),
    "flowered": ("flowered", "floral"),
    "speckled": ("speckled", "spotted"),
    "painted": ("painted",),
    "printed": ("printed",),
}
MATERIALS: dict[str, tuple[str, ...]] = {
    "wood": ("wooden", "wood"),
    "cloth": ("cloth", "fabric"),
    "metal": ("metal", "steel"),
    "plastic": ("plastic",),
    "pottery": ("ceramic", "pottery"),
    "marble": ("marble",),
    "wicker": ("wicker", "woven"),
    "cork": ("cork",),
    "paper": ("paper",),
    "glass": ("glass",),
    "leather": ("leather",),
    "wax": ("wax",),
    "canvas": ("canvas",),
    "plaster": ("plaster",),
    "stone": ("stone",),
}
# Nouns for captions that describe looks only.
NOUNS = ("object", "thing", "item")

TEMPLATES = ("{}", "{}", "{}", "{}", "{a} {}", "the {}", "a photo of {a} {}", "a picture of the {}")
_BARE = ("{} {noun}", "{} {noun}", "{}", "something {}")

# A color or material is true from the first fraction of a surface on, and false below the second.
MAIN_SHARE, TRACE_SHARE = 0.4, 0.12

_HELD_OUT_OF = 8


def held_out(color: str, category: str) -> bool:
    """Whether a category is never shown in a color during training: one combination in eight."""
    # A hash instead of a random choice: training and evaluation agree without a list.
    digest = hashlib.sha256(f"{color} {category}".encode()).digest()
    return int.from_bytes(digest[:4], "big") % _HELD_OUT_OF == 0


def phrased(template: str, words: str, noun: str = "") -> str:
    """Fill a template with words and the right article."""
    return template.format(words, a="an" if words[0] in "aeiou" else "a", noun=noun)


@dataclass(frozen=True, eq=False)
class Claims:
    """The statements that captions are made of, one per column of ``facts``.

    Attributes:
        phrases: synonymous phrases of every column.
        groups: kind of column -> first column and end: ``whole``, ``kind``, ``part``, ``piece`` (a part of a
            certain whole), ``color``, ``pattern``, ``material``.
        concepts: the concepts of the columns before ``color``.
    """

    phrases: tuple[tuple[str, ...], ...]
    groups: dict[str, tuple[int, int]]
    concepts: tuple[Concept, ...]

    def columns(self, group: str) -> range:
        """Columns of a group."""
        return range(*self.groups[group])


def make_claims(names: Sequence[str]) -> Claims:
    """All statements about crops with the given names."""
    pieces = [_piece(name) for name in names if "/" in name]
    concepts = {"whole": whole_concepts(), "kind": kind_concepts(), "part": part_concepts(), "piece": pieces}
    phrases = {group: [one.phrases for one in listed] for group, listed in concepts.items()}
    phrases["color"] = [(color,) for color in COLORS]
    phrases["pattern"], phrases["material"] = list(PATTERNS.values()), list(MATERIALS.values())
    ends = np.cumsum([len(listed) for listed in phrases.values()]).tolist()
    groups = {group: (end - len(phrases[group]), end) for group, end in zip(phrases, ends, strict=True)}
    return Claims(
        tuple(words for listed in phrases.values() for words in listed),
        groups,
        tuple(one for listed in concepts.values() for one in listed),
    )


def _piece(name: str) -> Concept:
    """The concept of a part of a certain whole: "cup handle", "handle of a mug"."""
    whole, _, part = name.partition("/")
    words = next((phrases for phrases, parts in PARTS.items() if part in parts.split(",")), (part,))
    phrases = [f"{owner} {words[0]}" for owner in WHOLES[whole]]
    phrases += [phrased(f"{word} of {{a}} {{}}", owner) for owner in WHOLES[whole] for word in (part, *words)]
    return Concept(tuple(dict.fromkeys(phrases)), frozenset({whole}), frozenset({part}))


def facts(claims: Claims, crops: Crops) -> Truth:
    """(N, columns) truth of every statement about every crop."""
    parts: dict[str, set[str]] = {}
    names, number = np.unique(crops.names, return_inverse=True)
    for whole, _, part in (name.partition("/") for name in names):
        parts.setdefault(whole, set()).add(part)
    share = np.stack([np.zeros(len(names)), np.ones(len(names))])
    table = np.array(
        [
            [
                [
                    one.truth(name, frozenset(parts[name.partition("/")[0]] - {""}), full)
                    for one in claims.concepts
                ]
                for name, full in zip(names, row, strict=True)
            ]
            for row in share
        ],
        dtype=np.int8,
    )
    said = table[(crops.share > 0.8).astype(int), number]
    surfaces, which = np.unique(crops.surfaces, return_inverse=True)
    shares = np.stack([_surface_shares(listed) for listed in surfaces])[which]
    return np.concatenate([said, _color_truth(crops.colors), _share_truth(shares)], axis=1)


def _surface_shares(listed: str) -> NDArray[np.float64]:
    """Fractions of every pattern and material, from ``Crops.surfaces``."""
    words = [*PATTERNS, *MATERIALS]
    shares = np.zeros(len(words))
    for surface, share in (one.rsplit(":", 1) for one in listed.split(",") if one):
        for word in surface.split():
            if word in words:
                shares[words.index(word)] += float(share)
    return shares


def _share_truth(shares: NDArray) -> Truth:
    return np.where(shares >= MAIN_SHARE, 1, np.where(shares >= TRACE_SHARE, -1, 0)).astype(np.int8)


def _color_truth(shares: NDArray) -> Truth:
    """Truth of colors: only the main color can be true."""
    main = shares == shares.max(axis=1, keepdims=True)
    return np.where(main, _share_truth(shares), np.where(shares >= TRACE_SHARE, -1, 0)).astype(np.int8)


def main_color(crops: Crops) -> NDArray[np.int64]:
    """(N,) index of the crop's main color, -1 if none dominates."""
    truth = _color_truth(crops.colors)
    return np.where((truth == 1).any(axis=1), crops.colors.argmax(axis=1), -1)


def unseen_combination(crops: Crops) -> NDArray[np.bool_]:
    """(N,) whether a crop shows an object, or a part of one, in a held-out combination of color and category."""
    color = main_color(crops)
    whole = crops.level == LEVELS.index("whole")
    found = {
        (world, number)
        for world, number, name, main in zip(
            crops.world[whole], crops.whole[whole], crops.names[whole], color[whole], strict=True
        )
        if name != OWN_ARMS and main >= 0 and held_out(COLORS[main], str(name))
    }
    return np.array([pair in found for pair in zip(crops.world, crops.whole, strict=True)], dtype=bool)


@dataclass(frozen=True, eq=False)
class Captions:
    """Texts and the statements that each makes.

    Attributes:
        texts: T texts; columns: (T, 4) columns of ``facts``, -1 for none.
    """

    texts: tuple[str, ...]
    columns: NDArray[np.int64]

    def truth(self, known: Truth) -> Truth:
        """(B, T) truth of the captions of crops with (B, columns) facts."""
        said = np.where(self.columns >= 0, known[:, self.columns], 1)
        return np.where((said == 0).any(-1), 0, np.where((said == -1).any(-1), -1, 1)).astype(np.int8)


def joined(*several: Captions) -> Captions:
    """Concatenate captions."""
    texts = tuple(text for one in several for text in one.texts)
    return Captions(texts, np.concatenate([one.columns for one in several]))


def bank(claims: Claims, rng: np.random.Generator) -> Captions:
    """One caption for every name and every single property, in random words."""
    texts, columns = [], []
    for group in ("whole", "kind", "part"):
        for column in claims.columns(group):
            texts.append(phrased(str(rng.choice(TEMPLATES)), str(rng.choice(claims.phrases[column]))))
            columns.append(column)
    for group in ("color", "pattern", "material"):
        for column in claims.columns(group):
            words = str(rng.choice(claims.phrases[column]))
            texts.append(phrased(str(rng.choice(_BARE)), words, str(rng.choice(NOUNS))))
            columns.append(column)
    claimed = np.full((len(columns), 4), -1, dtype=np.int64)
    claimed[:, 0] = columns
    return Captions(tuple(texts), claimed)


_NOUN_GROUPS = ("piece", "part", "whole", "kind")
# Probability that a caption mentions each property that the crop has.
_LOOKS = {"color": 0.75, "pattern": 0.3, "material": 0.3}


def describe(claims: Claims, known: Truth, rng: np.random.Generator) -> Captions:
    """One caption for each of the crops with (B, columns) facts: a name and its looks."""
    texts, columns = [], []
    for row in known:
        claimed, adjectives = [-1, -1, -1, -1], []
        for place, (group, often) in enumerate(_LOOKS.items(), 1):
            true = [column for column in claims.columns(group) if row[column] == 1]
            if true and rng.random() < often:
                claimed[place] = int(rng.choice(true))
                adjectives.append(str(rng.choice(claims.phrases[claimed[place]])))
        names = [column for group in _NOUN_GROUPS[:3] for column in claims.columns(group) if row[column] == 1]
        kinds = [column for column in claims.columns("kind") if row[column] == 1]
        draw = rng.random()
        if kinds and draw < 0.15:
            claimed[0] = int(rng.choice(kinds))
        elif names and (draw < 0.85 or not adjectives):
            claimed[0] = int(rng.choice(names))
        noun = str(rng.choice(claims.phrases[claimed[0]] if claimed[0] >= 0 else NOUNS))
        texts.append(phrased(str(rng.choice(TEMPLATES)), " ".join([*adjectives, noun])))
        columns.append(claimed)
    return Captions(tuple(texts), np.array(columns, dtype=np.int64))
