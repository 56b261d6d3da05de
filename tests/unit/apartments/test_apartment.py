"""Apartments are plausible: objects stand on objects and do not intersect."""

import itertools
import json

import numpy as np
import pytest

from egosplat.geometry import transform
from egosplat_apartments.camera.lighting import face_normals
from egosplat_apartments.camera.raycasting import Body, body_scene, build_geometry
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS
from egosplat_apartments.objects.model import boxes_touch
from egosplat_apartments.world.world import make_world
from tests.unit.apartments.conftest import OBJECTS, SMALL_WORLD

DIRECTIONS = np.random.default_rng(1).normal(size=(9, 3)).astype(np.float32)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
"""Along no axis and no diagonal: a ray through an edge or a corner says nothing of where its origin lies."""


def surface_points(thing, inwards):
    vertices = np.concatenate([part.shape.vertices for part in thing.model.parts])
    normals = np.concatenate([part.shape.normals for part in thing.model.parts])
    return transform(thing.pose, vertices - inwards * normals)


def is_inside(thing, points):
    points = points.astype(np.float32)
    found = np.zeros(len(points), dtype=bool)
    for part in thing.model.parts:
        geometry = build_geometry([Body(1, (part,), thing.pose, "static")])
        scene, votes = body_scene(geometry, 0, 1), np.zeros(len(points), dtype=int)
        for direction in DIRECTIONS:
            rays = np.broadcast_to(direction, points.shape)
            hits = scene.cast(points, rays)
            outward = face_normals(geometry, hits.face, np.zeros_like(rays))
            votes += (hits.face >= 0) & ((outward * rays).sum(axis=1) > 0)
        found |= votes > len(DIRECTIONS) / 2
    return found


def test_number_of_labeled_objects_is_as_configured(apartment, small_world):
    for home, objects in ((apartment, OBJECTS), (small_world.apartment, SMALL_WORLD["objects"])):
        instances = home.instances
        assert [one.category for one in instances].count("shelter") == 1
        assert len({one.category for one in instances}) > 12
        for one in instances:
            assert CATEGORY_UIDS[one.category] == one.category_uid
            assert (one.bounds[0] < one.bounds[1]).all()
        for name in ("name", "instance_id"):
            assert len({getattr(one, name) for one in instances}) == len(instances) == objects + 1
        assert {one.motion_type for one in instances} == {"static", "dynamic"}


def test_categories_are_adts(real_data):
    lists = json.loads((real_data("adt_names") / "adt_visible_objects_lists.json").read_text())
    assert set(CATEGORY_UIDS) - {"person"} <= set(lists["visible_object_categories"])
    assert len(set(CATEGORY_UIDS.values())) == len(CATEGORY_UIDS)
    instances = json.loads((real_data("adt_sample") / "instances.json").read_text()).values()
    known = {one["category"]: one["category_uid"] for one in instances}
    assert {name: known[name] for name in CATEGORY_UIDS if name in known}.items() <= CATEGORY_UIDS.items()


def test_different_seeds_give_different_apartments_and_walks_the_same(apartment, small_world):
    one, other = (
        [{thing.instance_id for thing in home.instances}, {thing.category for thing in home.instances}]
        for home in (apartment, small_world.apartment)
    )
    assert not one[0] & other[0] and one[1] != other[1]
    walls = [home.shell[0].texture.pixels.astype(float) for home in (apartment, small_world.apartment)]
    assert np.abs(walls[0] - walls[1]).mean() > 8
    again = make_world(**SMALL_WORLD, walk=1)
    poses = [[thing.pose for thing in world.apartment.things] for world in (again, small_world)]
    ways = [world.head.world_from_camera(np.linspace(0, 3, 7)) for world in (again, small_world)]
    assert np.array_equal(*poses) and np.abs(ways[0] - ways[1]).max() > 0.1


def test_objects_do_not_intersect(apartment):
    checked = 0
    for one, other in itertools.permutations(apartment.things, 2):
        if boxes_touch(one.bounds, other.bounds, 0.05):
            assert not is_inside(other, surface_points(one, inwards=0.004)).any()
            checked += 1
    assert checked > 5


def test_all_objects_are_in_the_room(apartment):
    half = np.array([apartment.room.width, apartment.room.depth]) / 2
    for thing in apartment.things:
        assert (np.abs(thing.bounds[:, [0, 2]]) <= half + 1e-6).all()
        assert thing.bounds[0, 1] >= -1e-6 and thing.bounds[1, 1] < apartment.room.height


def test_objects_stand_on_the_floor_or_on_their_support(apartment):
    things = apartment.things
    geometry = build_geometry([Body(1, thing.model.parts, thing.pose, "static") for thing in things])
    carried = [thing for thing in apartment.things if thing.support is not None]
    assert len(carried) >= 6
    for thing in carried:
        points = surface_points(thing, inwards=0.0)
        foot = points[points[:, 1] < points[:, 1].min() + 0.002].astype(np.float32)
        down = np.broadcast_to(np.array([0, -1, 0], np.float32), foot.shape)
        hits = body_scene(geometry, thing.support, thing.support + 1).cast(foot + [0, 0.02, 0], down)
        gap = hits.distance.min() - 0.02
        assert -0.004 < gap < 0.006
        # The support lies under its middle, so it does not topple.
        assert (foot.min(axis=0) - 0.01 <= points.mean(axis=0)).all(where=[True, False, True])
    for thing in apartment.things:
        if thing.support is None and thing.kind.place not in ("wall", "window"):
            assert thing.bounds[0, 1] == pytest.approx(0, abs=1e-9)


def test_the_floor_is_walkable_and_the_door_reachable(apartment):
    assert apartment.plan.reaches_door and apartment.plan.walkable_m2 > 2.5
    cells = np.argwhere(apartment.plan.inside)
    route = apartment.plan.route(*apartment.plan.place(cells[[0, -1]]))
    assert np.linalg.norm(np.diff(route, axis=0), axis=1).max() < 0.1
    for thing in apartment.things:
        if thing.bounds[0, 1] < 1.8:
            over = (route > thing.bounds[0, [0, 2]]) & (route < thing.bounds[1, [0, 2]])
            assert not over.all(axis=1).any()
