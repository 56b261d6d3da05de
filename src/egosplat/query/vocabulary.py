"""Words to try on a scene of a home, for suggestions and for naming what is at a place."""

from egosplat.models.open_clip_loader import OpenClip
from egosplat.query.text import untaught_words

# Things of a home. Synonyms are left out: they would share their scores.
THINGS = """
armchair, ball, basket, bed, blanket, book, bookshelf, bottle, bowl, box, cabinet, candle, carpet, ceiling, chair,
clock, coat, coffee table, couch, cup, curtain, cushion, cutting board, desk, dining table, door, dresser, floor,
flower, fridge, hand, kettle, keyboard, lamp, laptop, magazine, microwave, mirror, nightstand, oven, painting, person,
pillow, plant, plate, pot, remote control, rug, shelf, shoe, sink, speaker, stool, stove, table, teapot, television,
tissue box, toaster, towel, toy, trash can, vase, wall, window
"""


def words_to_try(clip: OpenClip) -> tuple[str, ...]:
    """The things of a home that a model knows, in alphabetical order."""
    phrases = (phrase.strip() for phrase in THINGS.replace("\n", " ").split(","))
    return tuple(sorted(phrase for phrase in phrases if not untaught_words(clip, phrase)))
