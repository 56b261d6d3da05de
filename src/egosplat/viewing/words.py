"""Put words on the page: features of a list of words, and the text tower of a small OpenCLIP for any other words."""

from typing import Any

import numpy as np
import torch

from egosplat.models.clip import OpenClip
from egosplat.models.without_compiler import without_compiler
from egosplat.query.text import encode_phrases
from egosplat.query.vocabulary import CARRIED, words_to_try
from egosplat.viewing.container import Arrays, Facts

with without_compiler():
    import open_clip

# Numbers of the largest text tower that is put on the page, 4 MB in half precision. The small OpenCLIP has 204,160; that
# of ViT-B-16 has 63 million.
MOST_NUMBERS = 2_000_000


def pack_words(clip: OpenClip, canonical: tuple[str, ...]) -> tuple[Arrays, Facts]:
    """Pack ``word_vectors`` (W, D) and ``canonical_vectors`` (K, D), float32 of unit norm, and a small tower under ``text/``.

    The fact ``tower`` is None without a tower: then the page answers only words of its list.
    """
    words = words_to_try(clip)
    weights, tower = _tower(clip)
    arrays = {
        "word_vectors": encode_phrases(clip, words).numpy(),
        "canonical_vectors": encode_phrases(clip, canonical).numpy(),
    }
    taught = sorted(clip.words) if isinstance(clip.words, frozenset) else None
    carried = [word in CARRIED for word in words]
    return arrays | weights, {"words": list(words), "carried": carried, "taught": taught, "tower": tower}


def _tower(clip: OpenClip) -> tuple[Arrays, Facts | None]:
    """Weights and tokenizer of a text tower that ``source/text.js`` computes; None for one that is too large or differs."""
    model = clip.model
    if not isinstance(model, open_clip.CLIP) or model.text_pool_type != "argmax" or not _is_plain(model):
        return {}, None
    named = {name: values for name, values in model.state_dict().items() if not name.startswith("visual.")}
    weights = {f"text/{name}": _half(values) for name, values in named.items() if values.ndim}
    if sum(values.size for values in weights.values()) > MOST_NUMBERS:
        return {}, None
    merges = sorted(clip.tokenizer.bpe_ranks, key=clip.tokenizer.bpe_ranks.__getitem__)
    block = model.transformer.resblocks[0]
    return weights, {
        "context": clip.tokenizer.context_length,
        "layers": len(model.transformer.resblocks),
        "heads": block.attn.num_heads,
        "epsilon": model.ln_final.eps,
        "quick_gelu": not isinstance(block.mlp.gelu, torch.nn.GELU),
        "merges": [" ".join(pair) for pair in merges],
        "start": clip.tokenizer.sot_token_id,
        "end": clip.tokenizer.eot_token_id,
    }


def _is_plain(model: Any) -> bool:
    """Whether the tower is the transformer of CLIP, without the extensions that OpenCLIP knows."""
    blocks = model.transformer.resblocks
    return isinstance(model.text_projection, torch.Tensor) and all(
        isinstance(block.ls_1, torch.nn.Identity) and isinstance(block.attn, torch.nn.MultiheadAttention)
        for block in blocks
    )


def _half(values: torch.Tensor) -> np.ndarray:
    """Half precision where it is exact, else float32."""
    full = values.float().cpu().numpy()
    half = full.astype(np.float16)
    return half if np.array_equal(half.astype(np.float32), full) else full
