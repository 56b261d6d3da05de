"""Kinds of objects in an apartment: ADT category, placement, and builder."""

import csv
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects import (
    containers,
    furniture,
    gadgets,
    ornaments,
    seats,
    tableware,
    wall_things,
)
from egosplat_apartments.objects.model import Builder

Motion = Literal["static", "dynamic"]

# ADT's category names used here, with ADT's numbers where its sample has them.
with Path(__file__).with_name("categories.csv").open(newline="", encoding="utf-8") as _lines:
    CATEGORY_UIDS = {row["category"]: int(row["number"]) for row in csv.DictReader(_lines)}


@dataclass(frozen=True)
class Kind:
    """A kind of object.

    Attributes:
        prototype: base of the instances' names.
        category: one of ``CATEGORY_UIDS``.
        motion_type: ADT's label for objects of this kind.
        build: function that makes one.
        place: ``back`` (its back to a wall), ``table front`` (in front of the couch), ``middle`` (free in the
            room), ``chair`` (at the dining table), ``floor`` (near a wall), ``wall``, ``window``, or, for
            objects that stand on others, the uses of the suitable surfaces, joined by ``/``.
        varied: whether each one looks different and has a prototype of its own.
        hand: whether a person can carry it.
    """

    prototype: str
    category: str
    motion_type: Motion
    build: Builder
    place: str
    varied: bool = False
    hand: bool = False

    @property
    def stands_on(self) -> tuple[str, ...]:
        """Uses of the surfaces that it may stand on; none if it stands on the floor or hangs."""
        on_floor = {"back", "table front", "middle", "chair", "floor", "wall", "window"}
        return () if self.place in on_floor else tuple(self.place.split("/"))


_TABLE = "table"
_ANY = "table/shelf"

COUCH = Kind("Sofa", "couch", "static", seats.couch, "back")
COFFEE_TABLE = Kind("CoffeeTable", "coffee table", "static", furniture.coffee_table, "table front")
TV_STAND = Kind("TVUnit", "tv stand", "static", furniture.tv_stand, "back")
TELEVISION = Kind("BigScreenTV", "television", "static", gadgets.television, "television")
BOOKCASE = Kind("Bookcase", "bookcase", "static", furniture.bookcase, "back")
DINING_TABLE = Kind("ExtendableTable", "dining table", "static", furniture.dining_table, "middle")
DINING_CHAIR = Kind("DiningChair", "dining chair", "dynamic", seats.dining_chair, "chair")
BED_FRAME = Kind("BedFrame", "bed frame", "static", seats.bed_frame, "back")
MATTRESS = Kind("HybridMattress", "mattress", "static", seats.mattress, "bed")
STEP_STOOL = Kind("StepStool", "step stool", "dynamic", seats.step_stool, "floor")
COASTER = Kind("Coaster", "coaster", "dynamic", tableware.coaster, _TABLE)
CUP = Kind("CeramicMug", "cup", "dynamic", tableware.cup, _TABLE, varied=True, hand=True)
BOWL = Kind("FruitBowl", "bowl", "dynamic", tableware.bowl, _TABLE, hand=True)
BOX = Kind("DecorativeBox", "box", "dynamic", containers.box_with_lid, _TABLE, varied=True, hand=True)
BOOK = Kind("BookFiction", "book", "static", gadgets.book_standing, "shelf", varied=True)
LYING_BOOK = Kind("BookCooking", "book", "dynamic", gadgets.book_lying, _ANY, varied=True, hand=True)
ARTWORK = Kind("WallDecor", "wall artwork", "static", wall_things.wall_artwork, "wall", varied=True)

_CORE_FURNITURE = (COUCH, COFFEE_TABLE, TV_STAND, TELEVISION, ARTWORK, STEP_STOOL)
_CORE_THINGS = (BOWL, BOX, COASTER, CUP)
# Kinds in every apartment.
CORE = (*_CORE_FURNITURE, *_CORE_THINGS)

# Furniture that is placed together; the order of the groups differs between apartments.
GROUPS = (
    (DINING_TABLE, DINING_CHAIR, DINING_CHAIR),
    (BED_FRAME, MATTRESS),
    (BOOKCASE, BOOK, BOOK, LYING_BOOK),
    (Kind("ApartmentRefrigerator", "refrigerator", "static", furniture.refrigerator, "back"),),
    (Kind("WhiteCabinet", "cabinet", "static", furniture.cabinet, "back"),),
    (Kind("WritingDesk", "desk", "static", furniture.desk, "back"),),
)

REST = (
    Kind("ArmChair", "armchair", "static", seats.armchair, "floor"),
    Kind("NightStand", "side table", "static", furniture.side_table, "back"),
    Kind("FloorPlant", "house plant", "static", ornaments.plant_tall, "floor", varied=True),
    Kind("TrashCan", "trash can", "dynamic", containers.trash_can, "floor"),
    Kind("LaundryBasket", "clothes basket", "static", containers.clothes_basket, "floor"),
    Kind("Basketball", "basketball", "dynamic", ornaments.ball, "floor", hand=True),
    Kind("WallClock", "wall clock", "static", wall_things.wall_clock, "wall"),
    Kind("FramePicture", "picture", "static", wall_things.picture, "wall", varied=True),
    Kind("FloatingShelf", "shelf", "static", wall_things.shelf, "wall"),
    Kind("WallClothesHanger", "wall-mounted coat rack", "static", wall_things.coat_rack, "wall"),
    Kind("HangingCurtain", "curtain", "static", wall_things.curtain, "window"),
    Kind("TableLamp", "desk lamp", "static", ornaments.desk_lamp, _TABLE),
    Kind("Pillow", "pillow", "static", ornaments.pillow, "soft", varied=True),
    Kind("VaseMedium", "vase", "static", containers.vase, _ANY, varied=True),
    Kind("TablePlant", "house plant", "static", ornaments.plant_small, _ANY, varied=True),
    Kind("WaterBottle", "bottle", "dynamic", tableware.bottle, _ANY, varied=True, hand=True),
    Kind("CeramicDish", "plate", "dynamic", tableware.plate, _TABLE, varied=True, hand=True),
    Kind("TissueBox", "tissue box", "static", containers.tissue_box, _ANY),
    Kind("CandlePattern", "candle", "static", ornaments.candle, _ANY, varied=True),
    Kind("Kettle", "tea kettle", "static", tableware.tea_kettle, _TABLE),
    Kind("CatFigure", "figurine", "static", ornaments.figurine, _ANY),
    Kind("DinoToy", "toy", "dynamic", ornaments.toy, _ANY, hand=True),
    Kind("BlackLaptop", "laptop computer", "dynamic", gadgets.laptop, _TABLE),
    Kind("RedClock", "desk clock", "dynamic", gadgets.desk_clock, _ANY, hand=True),
    Kind("SpeakerSmall", "speaker", "static", gadgets.speaker, _ANY),
    Kind("TvRemote", "remote control", "static", gadgets.remote_control, _TABLE),
    Kind("Magazine", "magazine", "static", gadgets.magazine, _TABLE, varied=True),
    Kind("Toaster", "toaster", "static", tableware.toaster, _TABLE),
    Kind("ChoppingBoard", "cutting board", "dynamic", tableware.cutting_board, _TABLE),
    Kind("LargePot", "pot", "dynamic", tableware.pot, _TABLE, hand=True),
    CUP,
)

# Kinds that fill up a large number of objects.
MORE = (CUP, LYING_BOOK, BOOK, BOX, ARTWORK, COASTER)


def wish_list(rng: Rng, objects: int) -> list[Kind]:
    """Kinds in the order of placement, until ``objects`` have been placed.

    The list is longer than ``objects``, because some find no place. Each category comes once before any
    repeats, except within groups.
    """
    chosen, late = _groups(rng, max(1, round((objects - len(CORE)) / 5)))
    rest = [REST[number] for number in rng.permutation(len(REST))]
    fill = [MORE[number % len(MORE)] for number in range(3 * objects)]
    split = len(rest) * 2 // 3
    return [*_CORE_FURNITURE, *chosen, *_CORE_THINGS, *rest[:split], *late, *rest[split:], *fill]


def busy_wish_list(rng: Rng, objects: int) -> list[Kind]:
    """Kinds as ``wish_list`` has them, for people who carry things: more tables and shelves, and less that never moves."""
    by_name = {kind.prototype: kind for kind in (*REST, *(kind for group in GROUPS for kind in group))}
    chosen, late = _groups(rng, max(1, (objects - 16) // 4))
    tables = [
        by_name[name] for name in ("NightStand", "NightStand", "WhiteCabinet", "ArmChair", "FloatingShelf")
    ]
    rest = [REST[number] for number in rng.permutation(len(REST)) if REST[number] not in tables]
    carried = [kind for kind in rest if kind.hand and kind.stands_on]
    # What stands on tables alone and never moves would leave no room on them.
    others = [kind for kind in rest if kind not in carried and kind.place != _TABLE]
    fill = [(CUP, BOOK, BOX, ARTWORK, LYING_BOOK)[number % 5] for number in range(3 * objects)]
    first = [*_CORE_FURNITURE, *chosen, *tables, BOOKCASE, *_CORE_THINGS]
    return [*first, *carried, *late, *others, *fill]


def _groups(rng: Rng, share: int) -> tuple[list[Kind], list[Kind]]:
    """The kinds of so many random ``GROUPS``, more for a fuller apartment, and of the others."""
    groups = [GROUPS[number] for number in rng.permutation(len(GROUPS))]
    return [*itertools.chain(*groups[:share])], [*itertools.chain(*groups[share:])]


def random_ids(rng: Rng, count: int) -> list[int]:
    """Distinct instance ids with as many digits as ADT's: sixteen."""
    ids: set[int] = set()
    while len(ids) < count:
        ids.add(int(rng.integers(3_500_000_000_000_000, 8_900_000_000_000_000)))
    return [int(value) for value in rng.permutation(np.array(sorted(ids)))]
