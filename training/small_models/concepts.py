"""Concepts of the synthetic world, each with synonyms: objects, pieces of the building, parts and kinds.

These words are used in captions of images; those of ``glossary.py`` never are.
"""

from dataclasses import dataclass

# Phrases for every whole; the first is the name that ADT gives it, if it does.
WHOLES: dict[str, tuple[str, ...]] = {
    "armchair": ("armchair", "lounge chair"),
    "basketball": ("basketball", "ball"),
    "bed frame": ("bed frame", "bedstead"),
    "book": ("book", "novel"),
    "bookcase": ("bookcase", "bookshelf"),
    "bottle": ("bottle", "water bottle"),
    "bowl": ("bowl", "fruit bowl", "bowl of fruit"),
    "box": ("box", "gift box", "decorative box"),
    "cabinet": ("cabinet", "sideboard"),
    "candle": ("candle", "burning candle"),
    "clothes basket": ("clothes basket", "laundry basket"),
    "coaster": ("coaster", "drink coaster"),
    "coffee table": ("coffee table", "low table"),
    "couch": ("couch", "sofa"),
    "cup": ("cup", "mug", "coffee mug"),
    "curtain": ("curtain", "drapes"),
    "cutting board": ("cutting board", "chopping board"),
    "desk": ("desk", "writing desk"),
    "desk clock": ("desk clock", "alarm clock"),
    "desk lamp": ("desk lamp", "table lamp"),
    "dining chair": ("dining chair", "kitchen chair"),
    "dining table": ("dining table", "kitchen table"),
    "figurine": ("figurine", "cat figurine", "statuette"),
    "house plant": ("house plant", "potted plant", "plant"),
    "laptop computer": ("laptop computer", "laptop"),
    "magazine": ("magazine", "journal"),
    "mattress": ("mattress", "bedding"),
    "person": ("person", "human", "somebody"),
    "picture": ("picture", "framed picture"),
    "pillow": ("pillow", "cushion"),
    "plate": ("plate", "dinner plate", "plate with cake"),
    "pot": ("pot", "cooking pot", "saucepan"),
    "refrigerator": ("refrigerator", "fridge"),
    "remote control": ("remote control", "tv remote", "remote"),
    "shelf": ("shelf", "wall shelf"),
    "side table": ("side table", "night stand", "bedside table"),
    "speaker": ("speaker", "loudspeaker"),
    "step stool": ("step stool", "stepladder", "stool"),
    "tea kettle": ("tea kettle", "kettle"),
    "television": ("television", "tv", "television set"),
    "tissue box": ("tissue box", "box of tissues", "tissues"),
    "toaster": ("toaster", "toaster with bread"),
    "toy": ("toy", "toy dinosaur", "dinosaur"),
    "trash can": ("trash can", "waste bin", "garbage can"),
    "tv stand": ("tv stand", "tv unit", "media console"),
    "vase": ("vase", "flower vase", "vase with flowers"),
    "wall artwork": ("wall artwork", "painting", "wall art"),
    "wall clock": ("wall clock", "round clock"),
    "wall-mounted coat rack": ("wall-mounted coat rack", "coat rack", "clothes hanger"),
    "own arms": ("arms", "arms and hands"),
    "floor": ("floor", "wooden floor", "floorboards"),
    "rug": ("rug", "carpet"),
    "ceiling": ("ceiling",),
    "lamp": ("ceiling lamp", "ceiling light"),
    "wall": ("wall", "wallpaper"),
    "skirting": ("skirting", "baseboard"),
    "corridor walls": ("corridor wall", "corridor walls"),
    "corridor floor": ("corridor floor", "stone floor"),
    "corridor ceiling": ("corridor ceiling",),
    "corridor lamp": ("corridor lamp",),
    "door mat": ("door mat", "doormat"),
    "door": ("door", "doorway"),
    "window": ("window",),
}

_FURNITURE = (
    "armchair,bed frame,bookcase,cabinet,coffee table,couch,desk,dining chair,dining table,shelf,side table,"
    "step stool,tv stand"
)
_BUILDING = "floor,ceiling,wall,skirting,corridor walls,corridor floor,corridor ceiling,door,window"

# Words for several wholes.
KINDS: dict[tuple[str, ...], str] = {
    ("furniture", "piece of furniture"): _FURNITURE,
    ("chair", "seat"): "armchair,dining chair",
    ("table",): "coffee table,dining table,side table,desk",
    ("bed",): "bed frame,mattress",
    ("clock",): "desk clock,wall clock",
    ("lamp", "light"): "desk lamp,lamp,corridor lamp",
    ("electronics", "electronic device"): "television,laptop computer,remote control,speaker",
    ("kitchenware", "tableware"): "cup,bowl,plate,pot,tea kettle,cutting board,toaster,bottle",
    ("container",): "box,trash can,clothes basket,vase,bottle,bowl,pot,tissue box",
    ("wall decoration", "art"): "picture,wall artwork",
    ("person or arm", "human body"): "person,own arms",
    ("building", "room", "shelter", "apartment"): _BUILDING,
    ("floor covering",): "rug,door mat",
    ("reading material",): "book,magazine",
}

# Words for the builders' part names.
PARTS: dict[tuple[str, ...], str] = {
    ("body", "main part"): "body,base,case,dish,chest",
    ("leg", "legs"): "legs",
    ("foot", "feet"): "feet,foot",
    ("arm", "arms of a chair"): "arms",
    ("back", "backrest"): "back",
    ("handle", "handles"): "handle,handles",
    ("lid",): "lid",
    ("drawer", "drawers"): "drawers",
    ("cabinet door", "doors"): "doors",
    ("knob", "knobs"): "knobs",
    ("screen",): "screen",
    ("keyboard", "keys"): "keyboard",
    ("buttons", "button"): "buttons",
    ("leaves", "leaf"): "leaves",
    ("stem", "stalk"): "stem,stems",
    ("flowers", "blossoms"): "blossoms",
    ("flower pot", "plant pot"): "pot",
    ("table top", "tabletop"): "top",
    ("shelves", "shelf board"): "shelves,board,lower shelf",
    ("side", "side board"): "sides",
    ("picture frame", "frame"): "frame,window frame,door frame",
    ("cushion", "seat cushion", "cushions"): "seat cushions,back cushions,pad",
    ("blanket",): "blanket",
    ("head board",): "head board",
    ("slats",): "slats",
    ("rails",): "rails",
    ("lamp shade", "shade"): "shade",
    ("light bulb", "bulb"): "bulb",
    ("clock face", "dial"): "dial",
    ("rim",): "rim",
    ("bells", "bell"): "bells",
    ("food", "something to eat"): "cake,bread,slices,fruit",
    ("fruit", "apple"): "fruit",
    ("cake", "slice of cake"): "cake",
    ("bread", "loaf of bread"): "bread",
    ("toast", "slices of toast"): "slices",
    ("coffee",): "coffee",
    ("label",): "label",
    ("cap", "bottle cap"): "cap",
    ("spout",): "spout",
    ("lever",): "lever",
    ("pedal",): "pedal",
    ("pail", "bucket"): "pail",
    ("ribbon", "bow"): "ribbon",
    ("tissue", "paper tissue"): "tissue",
    ("laundry", "clothes"): "laundry",
    ("coat", "jacket"): "coat",
    ("pegs", "coat hooks"): "pegs",
    ("curtain rod",): "rod",
    ("note", "magnet"): "note",
    ("pages", "paper pages"): "pages",
    ("cover", "book cover"): "cover,covers,back cover",
    ("spine", "spine of a book"): "spine",
    ("wax",): "wax",
    ("flame",): "flame",
    ("candle holder", "holder"): "holder",
    ("head",): "head,face",
    ("tail",): "tail",
    ("spikes",): "spikes",
    ("hand", "hands"): "hand",
    ("forearm",): "forearm",
    ("upper arm",): "upper arm",
    ("sleeve", "sleeves"): "sleeve",
    ("shirt", "torso"): "torso",
    ("trousers", "pants"): "pelvis,thigh,shin",
    ("shoe", "shoes"): "shoe",
    ("hair",): "hair",
    ("face",): "face",
    ("neck",): "neck",
    ("view from a window", "view", "outside"): "view",
    ("window frame",): "window frame,window reveal",
    ("window sill",): "window sill",
    ("door frame",): "door frame,door reveal",
    ("landscape",): "scene",
    ("canvas",): "canvas",
    ("plinth", "pedestal"): "plinth,pedestal",
    ("bracket", "brackets"): "brackets",
    ("step", "steps", "treads"): "treads",
    ("speaker cone", "cones"): "cones",
}

# For each whole, other wholes for which its words are neither true nor false.
RELATED: dict[str, tuple[str, ...]] = {
    "picture": ("wall artwork",),
    "wall artwork": ("picture",),
    "pillow": ("couch", "armchair"),
    "person": ("own arms",),
    "own arms": ("person",),
    "pot": ("house plant",),
    "bowl": ("plate",),
    "shelf": ("bookcase",),
    "wall": ("corridor walls",),
    "door": ("corridor walls",),
    "ceiling": ("corridor ceiling",),
    "floor": ("corridor floor",),
    "rug": ("door mat",),
    "lamp": ("corridor lamp",),
}

# Canonical phrases of relevancy: for any object less true than its name and truer than another name.
CANONICAL = ("object", "things", "stuff", "texture")


@dataclass(frozen=True)
class Concept:
    """A concept with synonymous phrases.

    Attributes:
        wholes: wholes that it is true of; for a concept of parts, the only wholes that have them (empty: any).
        parts: parts that it is true of; empty for a concept of wholes.
        related: wholes for which it is neither true nor false.
    """

    phrases: tuple[str, ...]
    wholes: frozenset[str] = frozenset()
    parts: frozenset[str] = frozenset()
    related: frozenset[str] = frozenset()

    def truth(self, name: str, parts: frozenset[str], share: float = 0.0) -> int:
        """Whether the concept is true of a crop: 1 (true), 0 (false) or -1 (undecided).

        Args:
            name: name of the crop, as in ``Crops.names``.
            parts: all parts of the crop's whole.
            share: fraction of the whole that a part's crop covers.
        """
        whole, _, part = name.partition("/")
        among = not self.wholes or whole in self.wholes
        if self.parts:
            if part:
                return int(among and part in self.parts)
            return -1 if among and parts & self.parts else 0
        if whole in self.wholes:
            # A part that is nearly the whole, or has its name, counts as the whole; other parts are undecided.
            return 1 if not part or share > 0.8 or part == whole.split()[-1] else -1
        return -1 if whole in self.related else 0


def _split(listed: str) -> frozenset[str]:
    return frozenset(listed.split(","))


def whole_concepts() -> list[Concept]:
    """One concept for every whole, in the order of ``WHOLES``."""
    return [
        Concept(phrases, frozenset({name}), related=frozenset(RELATED.get(name, ())))
        for name, phrases in WHOLES.items()
    ]


def kind_concepts() -> list[Concept]:
    """Concepts that cover several wholes."""
    return [Concept(phrases, _split(listed)) for phrases, listed in KINDS.items()]


def part_concepts() -> list[Concept]:
    """Concepts of parts of any whole."""
    return [Concept(phrases, parts=_split(listed)) for phrases, listed in PARTS.items()]
