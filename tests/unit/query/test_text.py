"""Features of phrases, by the small OpenCLIP."""

from dataclasses import replace

import pytest
import torch

from egosplat.errors import UserError
from egosplat.query.text import clean_phrase, encode_phrases, explain_untaught, untaught_words


def test_phrases_as_they_are_have_directions_of_their_own(clip):
    features = encode_phrases(clip, ("couch", "step stool", "couch"))
    assert features.shape[0] == 3 and features.dtype == torch.float32
    torch.testing.assert_close(features[0], features[2])
    assert features[0] @ features[1] < 0.99
    with clip.compute.inference():
        raw = torch.nn.functional.normalize(clip.model.encode_text(clip.tokenizer(["step stool"])).float())
    torch.testing.assert_close(features[1:2], raw, rtol=1e-5, atol=1e-6)


def test_a_phrase_that_cannot_be_encoded_is_reported_and_the_longest_is_not_cut(clip):
    room = clip.tokenizer.context_length - 2
    for phrase in (" ", "\u200b", "cup " * (room + 1), "\udcff"):
        with pytest.raises(UserError, match="query"):
            encode_phrases(clip, ["cup", phrase])
    assert encode_phrases(clip, ["cup " * (room // len(clip.tokenizer.encode("cup")))]).isfinite().all()


def test_characters_that_nobody_sees_change_nothing(clip):
    for phrase in ("cha\u200bir", "chair\ufeff", " chair\n", "\x00chair\x07", "\u202echair"):
        assert clean_phrase(phrase) == "chair" and untaught_words(clip, phrase) == []
        assert torch.equal(encode_phrases(clip, [phrase]), encode_phrases(clip, ["chair"]))


def test_a_model_without_a_direction_is_named(clip, monkeypatch):
    monkeypatch.setattr(clip.model, "encode_text", lambda tokens: torch.full((len(tokens), 4), float("nan")))
    with pytest.raises(UserError, match="'cup'.*clip_checkpoint"):
        encode_phrases(clip, ["cup"])


def test_the_small_model_knows_its_own_words_also_among_symbols(clip):
    for phrase in ("Green Bottle", "wall-mounted coat rack", "chair!", "ＣＨＡＩＲ", "(chair)", "chair 😀"):
        assert untaught_words(clip, phrase) == [], phrase
    assert untaught_words(clip, "wooden elephant on a couch") == ["elephant", "on"]


def test_symbols_are_no_query_and_letters_and_digits_of_any_script_are_words(clip):
    published = replace(clip, words=None)
    for phrase in ("::", "%", "™", "😀", "👩\u200d🚀", "---", "_", "\u0308", "&amp;", "&#37;", "<>", "、。"):
        for model in (published, replace(clip, words=frozenset({"chair"}))):
            assert "no word" in explain_untaught(model, phrase)[1], phrase
    for phrase in ("椅子", "стул", "כיסא", "2", "Ⅷ", "½"):
        assert untaught_words(published, phrase) == [] and untaught_words(clip, phrase), phrase
    for words, count in (("elephant elephant", 1), ("elephant on", 2)):
        untaught, why = explain_untaught(clip, words)
        assert why.count('"') == 2 * count and "never taught" in why and " ".join(untaught) == words
