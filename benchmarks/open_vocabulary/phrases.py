"""Phrases, grouped by what the small OpenCLIP was trained on."""

from training.small_models.captions import held_out
from training.small_models.glossary import COLOR_GLOSSARY, GLOSSARY

# Synonyms by category; none of their words is in a caption or in the glossary.
UNTAUGHT: dict[str, tuple[str, ...]] = {
    "armchair": ("fauteuil",),
    "bed frame": ("berth",),
    "book": ("tome", "textbook"),
    "bookcase": ("shelving",),
    "bottle": ("decanter",),
    "bowl": ("tureen",),
    "box": ("crate", "parcel"),
    "cabinet": ("credenza",),
    "candle": ("votive",),
    "couch": ("chesterfield", "divan"),
    "cup": ("goblet", "teacup"),
    "curtain": ("drapery",),
    "cutting board": ("butcher block",),
    "desk": ("escritoire",),
    "desk lamp": ("luminaire",),
    "figurine": ("carving",),
    "house plant": ("foliage",),
    "laptop computer": ("macbook",),
    "magazine": ("gazette",),
    "picture": ("snapshot",),
    "pillow": ("headrest",),
    "plate": ("platter",),
    "pot": ("cauldron",),
    "refrigerator": ("cooler",),
    "remote control": ("handset",),
    "shelf": ("mantel",),
    "side table": ("nightstand",),
    "speaker": ("subwoofer",),
    "tea kettle": ("boiler",),
    "television": ("monitor",),
    "tissue box": ("kleenex",),
    "trash can": ("wastebasket",),
    "vase": ("amphora",),
    "wall artwork": ("fresco",),
    "wall clock": ("horologe",),
    "wall-mounted coat rack": ("hallstand",),
}

NAME, GLOSSED, NEW = "the name", "a synonym of the glossary", "a synonym of neither"
TAUGHT_PAIR, LEFT_OUT_PAIR = "color and name, taught together", "color and name, never shown together"
GLOSSED_PAIR = "color and name, both of the glossary"

# In the order of the table.
KINDS = (NAME, GLOSSED, NEW, TAUGHT_PAIR, LEFT_OUT_PAIR, GLOSSED_PAIR)


def synonym_phrases(category: str) -> dict[str, tuple[str, ...]]:
    """What a category is asked by, by kind: its name, and synonyms that no picture was captioned with."""
    return {NAME: (category,), GLOSSED: GLOSSARY.get(category, ()), NEW: UNTAUGHT.get(category, ())}


def color_phrases(color: str, category: str) -> dict[str, str]:
    """What things of a category that have a color are asked by, by kind; ``NAME`` leaves the color out."""
    phrases = {NAME: category}
    phrases[LEFT_OUT_PAIR if held_out(color, category) else TAUGHT_PAIR] = f"{color} {category}"
    if category in GLOSSARY:
        phrases[GLOSSED_PAIR] = f"{COLOR_GLOSSARY[color][0]} {GLOSSARY[category][0]}"
    return phrases
