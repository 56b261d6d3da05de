"""Sentences say what the numbers say, and no more."""

import pytest

from egosplat.tradeoff.measured import chances, read_points
from egosplat.tradeoff.sentences import knob_sentences, presets_sentence


def of_knob(points, knob):
    read = read_points(points)
    return knob_sentences(read, knob, chances(read), 0.95)


def of_presets(points):
    read = read_points(points)
    return presets_sentence(read, chances(read), 0.95)


def test_a_difference_that_is_seen_is_told_with_its_interval(three_points):
    (told,) = of_knob(three_points, "splats.iterations")
    assert told.startswith("1500 instead of 7000 buys time (× 0.251, 0.238 to 0.265), ")
    assert "costs accuracy (−10.0 points, −12.8 to −7.2)" in told
    assert "mIoU (−5.0 points" in told
    assert told.endswith("no difference seen in disk and static PSNR.")


def test_a_difference_within_chance_is_not_claimed(point):
    points = [
        point([("features.dims", 16)], [0.50, 0.52, 0.48], [10.0, 10.1, 9.9], scene=True),
        point([("features.dims", 8)], [0.51, 0.46, 0.50], [10.0, 10.2, 9.9]),
    ]
    (told,) = of_knob(points, "features.dims")
    assert told.startswith(
        "8 instead of 16 makes no difference that was seen, in time, CPU time, memory, disk"
    )
    assert "buys" not in told and "costs" not in told


def test_a_cost_that_is_nearly_the_same_is_not_told_as_one(point):
    points = [
        point([("features.dims", 16)], [0.50, 0.52], [10.0, 10.0], scene=True),
        point([("features.dims", 8)], [0.51, 0.50], [10.03, 10.03]),
    ]
    (told,) = of_knob(points, "features.dims")
    assert told.startswith("8 instead of 16 makes no difference that was seen, in time, CPU time, memory")


def test_one_run_is_told_as_one_run(point):
    points = [
        point([("features.dims", 16)], [0.5], [10.0], scene=True),
        point([("features.dims", 8)], [0.2], [5.0]),
    ]
    (told,) = of_knob(points, "features.dims")
    assert "was measured too few times to tell what is chance" in told
    assert "accuracy (−30.0 points)" in told and "buys" not in told


def test_values_stand_in_order_and_those_that_change_nothing_are_told(point):
    own = [("masks.threshold", 0.65), ("masks.threshold", 0.1)]
    points = [point(own, [0.5], [10.0], scene=True)]
    points += [point([("masks.threshold", value)], [0.4], [9.0]) for value in (0.9, 0.5)]
    told = of_knob(points, "masks.threshold")
    assert [one.split(" ")[0] for one in told] == ["0.5", "0.9", "0.1"]
    assert told[-1] == "0.1 changes nothing of this scene."


@pytest.mark.parametrize("resolution, compared", [(512, True), (256, False)])
def test_psnr_is_compared_where_the_photographs_are_the_same(point, resolution, compared):
    def frames(size):
        return {"frames": {"resolution": size, "focal": 460.0, "upright": True}}

    points = [
        point([("a.b", 1)], [0.5, 0.5], [10.0, 10.1], scene=True, options=frames(512)),
        point([("a.b", 2)], [0.5, 0.5], [9.0, 9.1], options=frames(resolution), psnr=30.0),
    ]
    (told,) = of_knob(points, "a.b")
    assert ("static PSNR" in told) == compared


def test_balanced_against_the_papers_settings(three_points):
    told = of_presets(three_points)
    assert told.startswith("balanced takes 10.0 minutes, paper_scaled 100.0: it is 9.99 times as fast (9.")
    assert (
        "buys time (× 0.1, " in told and "no difference seen in disk, accuracy, mIoU and static PSNR" in told
    )
    assert of_presets(three_points[:1]) is None
