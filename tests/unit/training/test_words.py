"""The word list that is shipped with the small OpenCLIP is the one that training writes."""

from egosplat.models.configs import CLIP_WORDS, SMALL_CLIP
from training.small_models.clip_model import WORDS, write_description


def test_the_shipped_words_are_those_of_captions_and_glossary(tmp_path):
    write_description(tmp_path)
    assert WORDS == CLIP_WORDS
    assert (tmp_path / WORDS).read_text() == (SMALL_CLIP / CLIP_WORDS).read_text()
