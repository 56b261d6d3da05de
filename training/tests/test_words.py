"""The small OpenCLIP's word list is the one that training writes."""

from egosplat.models.checkpoints import CLIP_WORDS, SMALL_CLIP
from training.small_models.clip_model import WORDS, write_description


def test_the_word_list_equals_the_words_of_captions_and_glossary(tmp_path):
    write_description(tmp_path)
    assert WORDS == CLIP_WORDS
    assert (tmp_path / WORDS).read_text() == (SMALL_CLIP / CLIP_WORDS).read_text()
