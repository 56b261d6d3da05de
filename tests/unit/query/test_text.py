"""Features of phrases, by the small OpenCLIP."""

import pytest
import torch

from egosplat.errors import UserError
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query import text
from egosplat.query.options import CANONICAL
from egosplat.query.text import Texts, clean_phrase, encode_phrases, encode_texts, untaught_words


@pytest.fixture(scope="module")
def clip() -> OpenClip:
    return load_open_clip("small", "small", "cpu", "float32")


def test_phrases_have_directions_of_their_own(clip):
    features = encode_phrases(clip, ("couch", "step stool", "couch"))
    assert features.shape[0] == 3 and features.dtype == torch.float32
    torch.testing.assert_close(features.norm(dim=1), torch.ones(3))
    torch.testing.assert_close(features[0], features[2])
    assert features[0] @ features[1] < 0.99


def test_words_are_taken_as_they_are(clip):
    with clip.compute.inference():
        raw = clip.model.encode_text(clip.tokenizer(["tea kettle"])).float()
    expected = torch.nn.functional.normalize(raw, dim=-1)
    torch.testing.assert_close(encode_phrases(clip, ["tea kettle"]), expected, rtol=1e-5, atol=1e-6)


def test_queries_are_encoded_with_their_canonical_phrases(clip):
    texts = encode_texts(clip, ["couch", "cup"], CANONICAL)
    assert texts.phrases == ("couch", "cup") and texts.queries.shape[0] == 2 and texts.canonical.shape[0] == 4
    assert encode_texts(clip, [], CANONICAL).phrases == ()


@pytest.mark.parametrize(
    "phrase, reason",
    [(" ", "blank"), ("\u200b", "blank"), ("cup " * 200, "shorten it"), ("\udcff", "UTF-8")],
)
def test_invalid_phrases_are_reported(clip, phrase, reason):
    with pytest.raises(UserError, match=reason):
        encode_phrases(clip, ["cup", phrase])


@pytest.mark.parametrize(
    "phrase",
    [
        "cha\u200bir",
        "chair\ufeff",
        " chair\n",
        "\x00chair\x07",
        "\u202echair",
        "ch\u00adair",
        "\u2066chair\u2069",
    ],
)
def test_characters_that_nobody_sees_change_nothing(clip, phrase):
    """Zero-width, control and direction characters, and soft hyphens."""
    assert clean_phrase(phrase) == "chair" and untaught_words(clip, phrase) == []
    assert torch.equal(encode_phrases(clip, [phrase]), encode_phrases(clip, ["chair"]))


def test_the_longest_phrase_is_not_cut(clip):
    room = clip.tokenizer.context_length - 2
    longest = "cup " * (room // len(clip.tokenizer.encode("cup")))
    assert encode_phrases(clip, [longest]).isfinite().all()


def test_a_model_without_a_direction_is_named(clip, monkeypatch):
    monkeypatch.setattr(clip.model, "encode_text", lambda tokens: torch.full((len(tokens), 4), float("nan")))
    with pytest.raises(UserError, match="'cup'.*clip_checkpoint"):
        encode_phrases(clip, ["cup"])


def test_batches_cover_all_phrases(monkeypatch):
    monkeypatch.setattr(text, "AT_ONCE", 7)
    queries = torch.eye(5)
    parts = list(Texts(tuple("abcde"), queries, queries[:1]).in_batches(3))
    assert [part.phrases for part in parts] == [("a", "b"), ("c", "d"), ("e",)]
    assert torch.equal(torch.cat([part.queries for part in parts]), queries)
    assert all(torch.equal(part.canonical, queries[:1]) for part in parts)
