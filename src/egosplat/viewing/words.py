"""Put words on the page: features and answers of a list of words, and the text tower of a small OpenCLIP for any other words."""

from typing import Any

import numpy as np
import torch

from egosplat.models.clip import OpenClip
from egosplat.models.without_compiler import without_compiler
from egosplat.query.answers import Answer, as_json
from egosplat.query.catalog import catalog
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import NOT_ASKED, judge
from egosplat.query.like import SIMILARITY, Looks, find_name, give_name, read_names
from egosplat.query.options import MOST
from egosplat.query.reading import PATTERNS
from egosplat.query.sizes import Sizes, read_sizes
from egosplat.query.text import CARRIED, WORDS, encode_phrases, words_to_try
from egosplat.viewing.html import Arrays, Facts

with without_compiler():
    import open_clip

# Numbers of the largest text tower that is put on the page, 4 MB in half precision. The small OpenCLIP has 204,160; that
# of ViT-B-16 has 63 million.
MOST_NUMBERS = 2_000_000


def pack_words(scene: Scene) -> tuple[Arrays, Facts]:
    """Pack ``word_vectors`` (W, D) and ``canonical_vectors`` (K, D), float32 of unit norm, and a small tower under ``text/``.

    The fact ``answers`` has the verdict on each word. The fact ``tower`` is None without a tower: then the page alone answers
    only words of its list.
    """
    clip = scene.clip
    words = words_to_try(clip)
    # The page alone knows no words of homes that have to be won against.
    weights, tower = ({}, None) if scene.contest else _tower(clip)
    arrays = {
        "word_vectors": encode_phrases(clip, words).numpy(),
        "canonical_vectors": encode_phrases(clip, scene.options.canonical).numpy(),
    }
    return arrays | weights, {
        "words": list(words),
        "answers": [*map(page_answer, scene.answers(words))],
        "carried": [word in CARRIED for word in words],
        "taught": sorted(clip.words) if isinstance(clip.words, frozenset) else None,
        "tower": tower,
        "reading": PATTERNS | {"plurals": WORDS["plurals"]},
        "catalog": [*map(page_answer, catalog(scene))],
    }


def pack_sizes(sizes: Sizes | None, weight: float) -> tuple[Arrays, Facts]:
    """Pack ``size_odds`` (W, 1 + I) float32, what each instance's size, none's first, adds to log-odds of the fact ``size_words``."""
    if sizes is None or not weight:
        return {}, {"size_words": []}
    words = read_sizes()[0]
    return {"size_odds": np.roll(sizes.told(words, weight), 1, axis=1).astype(np.float32)}, {
        "size_words": words
    }


def ask_for_page(scene: Scene, phrase: str = "", like: str = "", name: str = "") -> Facts:
    """The ``answers`` to a phrase, or to an instance of the scene: what is ``like`` it, or a ``name`` that it is given now, as
    ``source/answer.js`` reads them. The best has the ``vector`` of its words. UserError: as ``Looks``."""
    instance = int(like[:9]) if like.isdecimal() else -1
    if name:
        give_name(scene, instance, phrase := name)
    known = read_names(scene.folder)
    if (key := find_name(phrase, known)) or like:
        looks = Looks(scene)
        own, features = (None, looks.called(key, known)) if key else looks.thing(instance)
        things = looks.find(features, MOST, but=own)
        answer = judge(key or "more like this", things, ((), None), SIMILARITY, MOST)
        return {"answers": [page_answer(answer) | {"measure": "similarity"}]}
    answers = scene.ask(phrase)
    best = next((one for one in answers if one.things), answers[0])
    told = [*map(page_answer, answers)]
    if best.phrase and not best.untaught and best.grade != NOT_ASKED:
        told[answers.index(best)]["vector"] = scene.encode([best.phrase]).queries[0].tolist()
    return {"answers": told}


def page_answer(answer: Answer) -> Facts:
    """An answer of the whole scene as ``source/answer.js`` reads it; ``level`` is that of the best match."""
    best = next(iter(answer.candidates), None)
    return as_json(answer) | {"asked": answer.asked, "level": best and best.level}


def _tower(clip: OpenClip) -> tuple[Arrays, Facts | None]:
    """Weights and tokenizer of a text tower that ``source/text.js`` computes; None for one that is too large or differs."""
    model = clip.model
    if not isinstance(model, open_clip.CLIP) or not isinstance(model.text_projection, torch.Tensor):
        return {}, None
    norm: Any = model.ln_final
    blocks: Any = model.transformer.resblocks
    # The transformer of CLIP, without the extensions that OpenCLIP knows.
    plain = model.text_pool_type == "argmax" and all(
        isinstance(block.ls_1, torch.nn.Identity) and isinstance(block.attn, torch.nn.MultiheadAttention)
        for block in blocks
    )
    named = {name: values for name, values in model.state_dict().items() if not name.startswith("visual.")}
    weights = {f"text/{name}": _half(values) for name, values in named.items() if values.ndim}
    if not plain or sum(values.size for values in weights.values()) > MOST_NUMBERS:
        return {}, None
    tokenizer: Any = clip.tokenizer
    return weights, {
        "context": tokenizer.context_length,
        "layers": len(blocks),
        "heads": blocks[0].attn.num_heads,
        "epsilon": norm.eps,
        "quick_gelu": not isinstance(blocks[0].mlp.gelu, torch.nn.GELU),
        "merges": [" ".join(pair) for pair in sorted(tokenizer.bpe_ranks, key=tokenizer.bpe_ranks.get)],
        "start": tokenizer.sot_token_id,
        "end": tokenizer.eot_token_id,
    }


def _half(values: torch.Tensor) -> np.ndarray:
    """Half precision where it is exact, else float32."""
    full = values.float().cpu().numpy()
    half = full.astype(np.float16)
    return half if np.array_equal(half.astype(np.float32), full) else full
