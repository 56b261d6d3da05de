"""The packaged small OpenCLIP: its words have the directions of what they mean, and its card names its file."""

import hashlib

from egosplat.models.checkpoints import SMALL_CLIP
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.text import encode_phrases

NAMES = ("couch", "television", "step stool", "house plant")
NAMES += ("coffee table", "bowl", "refrigerator", "tea kettle")
SYNONYMS = ("settee", "telly", "footstool", "shrub", "cocktail table", "basin", "icebox", "teapot")


def test_synonyms_outside_of_the_captions_are_nearest_to_their_names() -> None:
    clip = load_open_clip("small", "small", "cpu", "float32")
    nearest = (encode_phrases(clip, SYNONYMS) @ encode_phrases(clip, NAMES).T).argmax(dim=-1)
    assert nearest.tolist() == [*range(len(NAMES))]


def test_the_model_card_names_the_checkpoint_s_hash() -> None:
    digest = hashlib.sha256((SMALL_CLIP / "open_clip_model.safetensors").read_bytes()).hexdigest()
    assert digest in (SMALL_CLIP / "MODEL_CARD.md").read_text()
