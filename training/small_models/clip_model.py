"""A small OpenCLIP: its configuration, its folder, and a faster encoder for short texts."""

import json
from pathlib import Path
from typing import Any

import torch
from open_clip import CLIP, SimpleTokenizer
from open_clip.transformer import text_global_pool
from safetensors.torch import save_file
from torch import Tensor
from torch.nn import functional as F

from training.small_models.clip_views import IMAGE_PX, MEAN, STD
from training.small_models.clip_vocabulary import SINGLE_TOKENS, known_words, learn_merges, write_vocabulary
from training.small_models.schedule import half_precision

CONFIG, WEIGHTS, VOCABULARY = "open_clip_config.json", "open_clip_model.safetensors", "bpe.txt.gz"
WORDS = "words.txt"

_MOST_MERGES = 960


def write_description(folder: Path) -> None:
    """Write the configuration, the vocabulary and the known words of the small model."""
    folder.mkdir(parents=True, exist_ok=True)
    words = known_words()
    (folder / WORDS).write_text("\n".join(words) + "\n")
    merges = learn_merges(words, _MOST_MERGES)
    write_vocabulary(folder / VOCABULARY, merges)
    description = {
        "model_cfg": {
            "embed_dim": 128,
            "vision_cfg": {"image_size": IMAGE_PX, "layers": [1, 2, 2, 1], "width": 16, "patch_size": None},
            "text_cfg": {
                "context_length": 24,
                "vocab_size": SINGLE_TOKENS + len(merges),
                "width": 64,
                "heads": 4,
                "layers": 2,
            },
        },
        "preprocess_cfg": {"mean": MEAN, "std": STD, "interpolation": "bicubic", "resize_mode": "squash"},
    }
    (folder / CONFIG).write_text(json.dumps(description, indent=2) + "\n")


def build(folder: Path) -> tuple[CLIP, SimpleTokenizer]:
    """The model that a folder describes, with random weights, and its tokenizer."""
    shape: dict[str, Any] = json.loads((folder / CONFIG).read_text())["model_cfg"]
    length = shape["text_cfg"]["context_length"]
    return CLIP(**shape), SimpleTokenizer(bpe_path=str(folder / VOCABULARY), context_length=length)


def save_weights(model: CLIP, path: Path) -> None:
    """Write the weights in half precision."""
    save_file(half_precision(model.state_dict()), path, metadata={"format": "pt"})


def encode_short_text(model: CLIP, tokens: Tensor) -> Tensor:
    """(N, D) of unit norm: ``model.encode_text`` without the padding at the end of all N texts."""
    # The end-of-text token has the largest number of all, so argmax finds the end of each text.
    length = int(tokens.argmax(dim=1).max()) + 1
    tokens = tokens[:, :length]
    x = model.token_embedding(tokens) + model.positional_embedding[:length]
    x = model.ln_final(model.transformer(x, attn_mask=model.attn_mask[:length, :length]))
    return F.normalize(text_global_pool(x, tokens, model.text_pool_type) @ model.text_projection, dim=-1)


@torch.no_grad()
def encode_texts(model: CLIP, tokenizer: SimpleTokenizer, texts: list[str]) -> Tensor:
    """(N, D) text features of unit norm."""
    return encode_short_text(model, tokenizer(texts).to(model.positional_embedding.device))
