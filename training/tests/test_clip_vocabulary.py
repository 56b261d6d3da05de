"""OpenCLIP's tokenizer reads the small vocabulary: known words are one token, others several."""

import pytest
from open_clip import SimpleTokenizer

from training.small_models.clip_vocabulary import known_words, learn_merges, write_vocabulary


@pytest.fixture(scope="module")
def tokenizer(tmp_path_factory: pytest.TempPathFactory) -> SimpleTokenizer:
    """A tokenizer with all known words."""
    path = tmp_path_factory.mktemp("vocabulary") / "bpe.txt.gz"
    write_vocabulary(path, learn_merges(known_words(), 10_000))
    return SimpleTokenizer(bpe_path=str(path), context_length=16)


def test_known_words_are_single_tokens(tokenizer: SimpleTokenizer) -> None:
    assert [word for word in known_words() if len(tokenizer.encode(word)) != 1] == []


def test_unknown_words_are_spelled(tokenizer: SimpleTokenizer) -> None:
    tokens = tokenizer.encode("stegosaurus übung 7")
    assert len(tokens) > 3
    assert tokenizer.decode(tokens).strip() == "stegosaurus übung 7"


def test_the_most_frequent_pair_is_merged_first() -> None:
    assert learn_merges(["aab", "aac", "xy"], 1) == [("a", "a")]
    assert learn_merges(["ab"], 10) == [("a", "b</w>")]
