"""Words to try on a scene of a home, for suggestions and for naming what is at a place."""

from egosplat.models.clip import OpenClip
from egosplat.query.text import untaught_words


def _listed(text: str) -> tuple[str, ...]:
    return tuple(phrase.strip() for phrase in text.replace("\n", " ").split(","))


# Things of a home that people carry about. Synonyms are left out, here and below: they would share their scores.
CARRIED = _listed("""
ball, basket, blanket, book, bottle, bowl, box, candle, chair, clock, coat, cup, cushion, cutting board, flower, kettle,
keyboard, lamp, laptop, magazine, microwave, painting, pillow, plant, plate, pot, remote control, shoe, speaker, stool,
teapot, tissue box, toaster, towel, toy, trash can, vase
""")

# What stays, or carries.
STAYING = _listed("""
armchair, bed, bookshelf, cabinet, carpet, ceiling, coffee table, couch, curtain, desk, dining table, door, dresser,
floor, fridge, hand, mirror, nightstand, oven, person, rug, shelf, sink, stove, table, television, wall, window
""")


def words_to_try(clip: OpenClip) -> tuple[str, ...]:
    """The things of a home that a model knows, in alphabetical order."""
    return tuple(sorted(phrase for phrase in CARRIED + STAYING if not untaught_words(clip, phrase)))
