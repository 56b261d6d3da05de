"""The foreign world: the categories of the usual one in other shapes, surfaces, rooms and light."""

import numpy as np
import pytest

from egosplat_apartments.camera.lighting import make_lights
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS, CORE, GROUPS, MORE, REST
from egosplat_apartments.objects.foreign import build_foreign
from egosplat_apartments.objects.model import bounds_at, boxes_touch
from egosplat_apartments.world.apartment import make_apartment
from egosplat_apartments.world.room import Light, opening_box
from egosplat_apartments.world.world import STYLES

KINDS = {kind.prototype: kind for kind in (*CORE, *REST, *MORE, *(one for group in GROUPS for one in group))}


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_each_kind_has_another_shape_or_surface(kind):
    usual, other = kind.build(np.random.default_rng(3)), build_foreign(kind, np.random.default_rng(3))
    again = build_foreign(kind, np.random.default_rng(3))
    sizes = [np.ptp(bounds_at(model, np.eye(4)), axis=0) for model in (usual, other)]
    looks = [{part.texture.pixels.tobytes() for part in model.parts} for model in (usual, other, again)]
    assert not np.allclose(*sizes) or not looks[0] & looks[1]
    assert looks[1] == looks[2]
    for model in (usual, other):
        names = [part.name for part in model.parts]
        assert len(set(names)) == len(names) and (len(names) > 1 or kind.category == "basketball")
    low, high = bounds_at(other, np.eye(4))
    if kind.place not in ("wall", "window"):
        assert low[1] == pytest.approx(0, abs=0.03)
    uses = [{surface.use for surface in model.surfaces} for model in (usual, other)]
    assert uses[0] - {"shelf"} <= uses[1]
    for surface in other.surfaces:
        assert low[1] < surface.height <= high[1] + 1e-9
        assert (low[[0, 2]] - 1e-9 <= surface.lower).all() and (high[[0, 2]] + 1e-9 >= surface.upper).all()


@pytest.mark.parametrize("seed", [201, 202])
def test_things_stand_apart_in_a_room_that_is_another_and_can_be_walked_in(seed):
    home = make_apartment(np.random.default_rng([seed, 0]), 24, STYLES["foreign"])
    assert len(home.instances) == 25 and {one.category for one in home.instances} <= set(CATEGORY_UIDS)
    for thing in home.things:
        for block in home.room.blocks:
            assert not boxes_touch(thing.bounds, block, 0.0), thing.kind.category
        for other in home.things[: thing.number]:
            on = home.things[thing.support].support if thing.support is not None else None
            if other.number not in (thing.support, on):
                assert not boxes_touch(thing.bounds, other.bounds, 0.0)
    room = home.room
    assert room.width * room.depth > 20 and room.height >= 2.8 and len(room.windows) == 2
    assert home.plan.reaches_door and room.blocks
    for block in room.blocks:
        assert not any(boxes_touch(block, opening_box(room, opening), 0.0) for opening in room.openings)
        middle = block.mean(axis=0)[[0, 2]]
        assert home.plan.clearance_at(middle[None])[0] < 0.12
    lights = make_lights(room, np.random.default_rng(0))
    assert lights.lamp_power.tolist() != pytest.approx(Light().lamp)
    assert abs(lights.lamp[[0, 2]]).sum() > 0.05 and lights.sun[1] < 0.5
