"""The busy world: two people carry things on and on, and its truth says where each rests and when."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.worlds.statistics import statistics_of
from egosplat.errors import UserError
from egosplat.geometry import invert, transform
from egosplat_apartments.adt_format.adt import write_sequence
from egosplat_apartments.camera.lens import make_lens
from egosplat_apartments.objects.model import bounds_at, boxes_touch
from egosplat_apartments.stage import make_renderer, record_world
from egosplat_apartments.world.world import make_world

pytestmark = pytest.mark.slow

SEED, SECONDS, OBJECTS, FPS = 103, 60.0, 44, 1.0


@pytest.fixture(scope="module")
def world():
    return make_world(seed=SEED, seconds=SECONDS, objects=OBJECTS, motion=1.0, world="busy")


@pytest.fixture(scope="module")
def recording(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("busy") / "recording"
    sequence = record_world(world, make_renderer(world, make_lens(64)), name="b", fps=FPS, seconds=SECONDS)
    write_sequence(sequence, folder)
    return folder


@pytest.fixture(scope="module")
def rests(recording):
    return pd.read_csv(recording / "truth" / "rests.tsv", sep="\t")


def test_each_carried_thing_rests_at_places_for_seconds(world, rests):
    assert len(world.apartment.things) == OBJECTS
    assert len(world.people) == 2 and all(person.jobs for person in world.people)
    things = rests.groupby("object_uid")
    for _, rows in things:
        start, end = rows["from[ns]"].to_numpy(), rows["until[ns]"].to_numpy()
        assert start[0] == world.start_ns and end[-1] == world.start_ns + SECONDS * 1e9
        assert (start < end).all() and (end[:-1] < start[1:]).all()
        between = (end - start)[1:-1] * 1e-9
        assert len(between) >= 2 and (between >= 3).all() and (between <= 10).all()
        assert (rows.place_uid.to_numpy()[1:] != rows.place_uid.to_numpy()[:-1]).all()


def test_things_lie_still_on_their_places_and_in_no_other(world, rests):
    apartment = world.apartment
    number_of = {one.instance_id: number for number, one in enumerate(apartment.instances[1:])}
    for row in rests.itertuples():
        number, place = number_of[row.object_uid], number_of[row.place_uid]
        first, last = ((ns - world.start_ns) * 1e-9 for ns in (row[5], row[6]))
        poses = [world.moved_things(s)[number] for s in np.linspace(first + 0.01, last - 0.01, 3)]
        assert all(np.array_equal(pose, poses[0]) for pose in poses)
        thing = apartment.things[number]
        box = np.stack(bounds_at(thing.model, poses[0]))
        heights = [surface.height for surface in apartment.things[place].model.surfaces]
        assert np.abs(box[0, 1] - apartment.things[place].pose[1, 3] - heights).min() < 0.01
        for moment in np.linspace(first, last, 4):
            now = world.moved_things(float(moment))
            for other in apartment.things:
                if other.number in (number, place):
                    continue
                bounds = np.stack(bounds_at(other.model, now.get(other.number, other.pose)))
                assert not boxes_touch(box, bounds, -0.02), (thing.kind.category, other.kind.category)


def test_things_move_without_jumps_in_hands(world):
    times = np.arange(0, SECONDS, 0.05)
    paths = [world.moved_things(float(time)) for time in times]
    for number in paths[0]:
        places = np.array([poses[number][:3, 3] for poses in paths])
        assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.25
    for person in world.people:
        for job in person.jobs:
            box = np.stack(bounds_at(job.errand.thing.model, np.eye(4)))
            for moment in np.linspace(job.grip_s + 0.1, job.release_s - 0.1, 7):
                poses = person.thing_poses(float(moment))
                palm = person.joints(float(moment), poses)[11]
                local = transform(invert(poses[job.errand.thing.number]), palm[None])[0]
                off = np.maximum(0, np.maximum(box[0] - local, local - box[1]))
                assert np.linalg.norm(off) < 0.16, (job.errand.thing.kind.category, moment - job.grip_s)


def test_people_keep_apart_and_off_the_furniture(world):
    times = np.arange(0, SECONDS, 0.1)
    places = [person.walk.place(times) for person in world.people]
    assert np.linalg.norm(places[0] - places[1], axis=1).min() > 0.5
    for path in places:
        assert world.apartment.plan.clearance_at(path).min() > 0.1


def test_the_recording_reaches_the_aims_of_the_world(recording):
    found = statistics_of(recording)
    assert found.carried == found.moved >= 5 and found.places >= 2
    assert found.wearer >= 0.05 and found.others > 0 and found.movers > found.wearer + found.others
    assert found.half_hidden >= 0.5


@pytest.mark.parametrize(("seconds", "motion"), [(24.0, 0.9), (60.0, 0.3)])
def test_too_little_time_for_the_chores_is_an_error(seconds, motion):
    with pytest.raises(UserError, match=f"synthetic.world = busy: .* {seconds * motion:g} s"):
        make_world(seed=SEED, seconds=seconds, objects=OBJECTS, motion=motion, world="busy")
