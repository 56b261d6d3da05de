"""A small byte-pair vocabulary in the file format of OpenCLIP's ``SimpleTokenizer``."""

import gzip
import re
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

from training.small_models.attributes import COLORS
from training.small_models.captions import MATERIALS, NOUNS, PATTERNS, TEMPLATES
from training.small_models.concepts import CANONICAL, KINDS, PARTS, WHOLES
from training.small_models.glossary import COLOR_GLOSSARY, GLOSSARY

Merge = tuple[str, str]

# Bytes, bytes that end a word, and the two markers of start and end.
SINGLE_TOKENS = 2 * 256 + 2


def known_words() -> list[str]:
    """All words of captions and of the glossary."""
    phrases = [
        *NOUNS,
        *CANONICAL,
        *COLORS,
        "something",
        "an",
        *(text.replace("{a}", "a") for text in TEMPLATES),
    ]
    phrases += [*KINDS, *PARTS] and [phrase for key in (*KINDS, *PARTS) for phrase in key]
    for table in (WHOLES, PATTERNS, MATERIALS, GLOSSARY, COLOR_GLOSSARY):
        phrases += [phrase for listed in table.values() for phrase in listed]
    return sorted({word for phrase in phrases for word in re.findall("[a-z]+", phrase)})


def learn_merges(words: Iterable[str], most: int) -> list[Merge]:
    """Merges of byte-pair encoding, most frequent pair first, until every word is one token or there are ``most``.

    Words are lower-case ASCII.
    """
    spelled = [[*word[:-1], word[-1] + "</w>"] for word in sorted(set(words))]
    merges: list[Merge] = []
    while len(merges) < most:
        pairs = Counter(pair for pieces in spelled for pair in pairwise(pieces))
        if not pairs:
            break
        # Ties go to the alphabetically first pair, so that the vocabulary is reproducible.
        merge = min(pairs, key=lambda pair: (-pairs[pair], pair))
        merges.append(merge)
        spelled = [_merged(pieces, merge) for pieces in spelled]
    return merges


def _merged(pieces: list[str], merge: Merge) -> list[str]:
    result: list[str] = []
    for piece in pieces:
        if result and (result[-1], piece) == merge:
            result[-1] += piece
        else:
            result.append(piece)
    return result


def write_vocabulary(path: Path, merges: list[Merge]) -> None:
    """Write ``bpe.txt.gz``, the same bytes for the same merges."""
    # The tokenizer skips the first line, and would read an empty last one as a merge of nothing.
    lines = ["#version: 0.2", *(" ".join(merge) for merge in merges)]
    # No file name and time in the gzip header: the same merges give the same bytes.
    with path.open("wb") as file, gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0) as packed:
        packed.write("\n".join(lines).encode())
