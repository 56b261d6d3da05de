"""Each alarm is raised just beyond its limit, and not at the limit."""

import dataclasses
import math

import numpy as np
import pytest

from egosplat.alarms import instances, recording, scene
from egosplat.alarms.alarm import Alarm

EPSILON = 1e-6
FINE = np.array([30.0])


BELOW = {
    "frames.valid_pixels": (lambda share: recording.frames_alarms(share, 0.0), recording.MIN_VALID_PIXELS),
    "poses.registered": (lambda share: recording.poses_alarms(share, None, []), recording.MIN_REGISTERED),
    "poses.parallax": (
        lambda angle: recording.poses_alarms(1.0, None, [], angle),
        recording.MIN_PARALLAX_DEG,
    ),
    "segments.instances_per_frame": (
        lambda mean: instances.segments_alarms(0.0, mean, 30.0),
        instances.MIN_INSTANCES_PER_FRAME,
    ),
    "segments.frames_per_instance": (
        lambda mean: instances.segments_alarms(0.0, 30.0, mean),
        instances.MIN_FRAMES_PER_INSTANCE,
    ),
    "instances.masks_kept": (
        lambda share: instances.instances_alarms(share * 1e6, 1e6, None),
        instances.MIN_MASKS_KEPT,
    ),
    # With a mean cosine of 0 between instances.
    "features.agreement": (
        lambda cosine: instances.features_alarms(0, 10, cosine, 0.0, 1.0),
        instances.MIN_AGREEMENT,
    ),
    "features.reconstruction": (
        lambda cosine: instances.features_alarms(0, 10, 1.0, 0.0, cosine),
        instances.MIN_RECONSTRUCTION,
    ),
    "splats.psnr": (lambda decibels: scene.splats_alarms(np.array([decibels])), scene.MIN_PSNR_DB),
}


def corrected(angle: float, gain: float):
    """The alarms of two frames, one of them with a shift of ``angle`` depths and a gain of blue."""
    shift, gains = np.array([0.0, 2.0 * angle]), np.array([[1.0, 1.0, gain], [1.0, 1.0, 1.0]])
    return scene.corrections_alarms(shift, np.zeros(2), gains, 2.0)


ABOVE = {
    "frames.blurred": (lambda share: recording.frames_alarms(1.0, share), recording.MAX_BLURRED),
    "poses.reprojection": (
        lambda pixels: recording.poses_alarms(1.0, pixels, [10]),
        recording.MAX_REPROJECTION_PX,
    ),
    "segments.empty_pixels": (
        lambda share: instances.segments_alarms(share, 30.0, 30.0),
        instances.MAX_EMPTY_PIXELS,
    ),
    "instances.empty_pixels": (
        lambda share: instances.instances_alarms(None, None, share),
        instances.MAX_EMPTY_AFTER_MERGING,
    ),
    "transient.probability": (scene.transient_alarms, scene.MAX_PROBABILITY),
    "masks.pixels": (lambda share: scene.masks_alarms(0, 10, share), scene.MAX_MASKED_PIXELS),
    "language.without_code": (scene.language_alarms, scene.MAX_WITHOUT_CODE),
    "splats.pose_correction": (lambda angle: corrected(angle, 1.0), scene.MAX_CORRECTION),
    "splats.gain": (lambda gain: corrected(0.0, gain), scene.MAX_GAIN),
}
"""By key: the alarms of one figure, and its limit."""


@pytest.mark.parametrize("key", BELOW | ABOVE)
def test_an_alarm_is_raised_just_beyond_its_limit_and_not_at_it(key):
    alarms, limit = (BELOW | ABOVE)[key]
    assert list(alarms(limit)) == []
    assert [alarm.key for alarm in alarms(limit + (EPSILON if key in ABOVE else -EPSILON))] == [key]


@pytest.mark.parametrize(
    "alarms, key",
    [
        (lambda count: scene.masks_alarms(count, 100, 0.0), "masks.instances"),
        (lambda count: instances.features_alarms(count, 200, 1.0, 0.0, 1.0), "features.outliers"),
        (lambda count: instances.view_features_alarms(count - 49, 99), "view_features.lost"),
    ],
)
def test_counts_raise_an_alarm_one_above_their_limit(alarms, key):
    """50 of 100 instances, 50 of 200 views, 1 of 100 views are the limits."""
    assert list(alarms(50)) == []
    assert [alarm.key for alarm in alarms(51)] == [key]


def test_a_second_model_of_colmap_raises_an_alarm_that_names_both():
    assert list(recording.poses_alarms(1.0, 0.3, [40])) == []
    (alarm,) = recording.poses_alarms(1.0, 0.3, [40, 7])
    assert alarm.key == "poses.models" and "40, 7" in alarm.found


def test_agreement_is_relative_to_the_spread_between_instances():
    """A cosine of 0.7 is normal if instances differ much, and an alarm if they are similar."""
    assert list(instances.features_alarms(0, 10, 0.7, 0.2, 1.0)) == []
    assert [one.key for one in instances.features_alarms(0, 10, 0.7, 0.5, 1.0)] == ["features.agreement"]
    assert instances.agreement_of(1.0, 1.0) == 1.0, "equal instances have equal views"


def test_missing_figures_raise_no_alarm():
    found = [
        *recording.frames_alarms(None, None),
        *recording.poses_alarms(None, None, []),
        *instances.segments_alarms(None, None, None),
        *instances.instances_alarms(None, None, None),
        *instances.instances_alarms(0, 0, None),
        *instances.view_features_alarms(0, 0),
        *instances.features_alarms(0, 0, None, None, None),
        *scene.transient_alarms(None),
        *scene.masks_alarms(0, 0, None),
        *scene.splats_alarms(np.zeros(0)),
        *scene.language_alarms(None),
    ]
    assert found == []


def test_an_accuracy_whose_interval_reaches_chance_raises_an_alarm():
    assert list(scene.metrics_alarms(0.15 + EPSILON, 0.15)) == list(scene.metrics_alarms(None, 0.15)) == []
    assert [alarm.key for alarm in scene.metrics_alarms(0.15, 0.15)] == ["metrics.chance"]


def test_infinite_psnr_raises_no_alarm_and_nan_does():
    assert list(scene.splats_alarms(np.array([math.inf]))) == []
    assert [alarm.key for alarm in scene.splats_alarms(np.array([math.nan]))] == ["splats.psnr"]


@pytest.mark.parametrize("key", BELOW | ABOVE)
def test_an_alarm_is_one_line_with_limit_value_and_advice(key):
    alarms, limit = (BELOW | ABOVE)[key]
    beyond = limit * (0.5 if key in BELOW else 2.0)
    (alarm,) = alarms(beyond)
    text = str(alarm)
    assert "\n" not in text and all(text.count(value) for value in dataclasses.astuple(alarm))
    assert isinstance(alarm, Alarm) and alarm.key == key
