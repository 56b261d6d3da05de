"""Each alarm is raised just beyond its limit, and not at the limit."""

import math

import pytest

from egosplat.alarms.artifact_alarms import agreement_of
from egosplat.alarms.limits import LIMITS, find_alarm, find_chance_alarm

EPSILON = 1e-6


@pytest.mark.parametrize("key", LIMITS)
def test_an_alarm_is_raised_just_beyond_its_limit_and_not_at_it(key):
    limit = LIMITS[key]
    beyond = limit.value + (EPSILON if limit.normal_is_below else -EPSILON)
    assert list(find_alarm(key, limit.value)) == []
    (alarm,) = find_alarm(key, beyond, more=3)
    assert (alarm.key, alarm.figures) == (key, {"value": beyond, "limit": limit.value, "more": 3})


@pytest.mark.parametrize("key", LIMITS)
def test_an_unknown_value_raises_no_alarm(key):
    assert list(find_alarm(key, None)) == []


def test_infinite_psnr_raises_no_alarm_and_nan_does():
    assert list(find_alarm("splats.psnr", math.inf)) == []
    assert [alarm.key for alarm in find_alarm("splats.psnr", math.nan)] == ["splats.psnr"]


def test_an_accuracy_whose_interval_reaches_chance_raises_an_alarm():
    assert list(find_chance_alarm(0.15 + EPSILON, 0.15)) == list(find_chance_alarm(None, 0.15)) == []
    assert [alarm.key for alarm in find_chance_alarm(0.15, 0.15)] == ["metrics.chance"]


def test_agreement_is_relative_to_the_spread_between_instances():
    """A cosine of 0.7 is normal if instances differ much, and an alarm if they are similar."""
    limit = LIMITS["features.agreement"]
    assert not limit.is_passed(agreement_of(0.7, 0.2)) and limit.is_passed(agreement_of(0.7, 0.5))
    assert agreement_of(1.0, 1.0) == 1.0, "equal instances have equal views"
