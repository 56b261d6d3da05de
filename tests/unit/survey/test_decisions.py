"""Decisions of a survey from its measurements, and what it cannot tell."""

import numpy as np
import pytest

from egosplat.survey.decisions import decide_camera, decide_motion, finite
from egosplat.survey.motion import Motion


def motion(lasting=0.0, fleeting=0.0, voting=0.5, noise=0.1, before=0.1, pairs=6, revisits=0, stops=0.0):
    """Equal pairs; ``before``: noise without a correction [px]."""
    frames, every = np.arange(pairs + 1), np.ones(pairs + revisits)
    return Motion(
        pairs=np.stack([frames[:-1], frames[1:]], axis=1),
        moving=np.full(pairs, lasting + fleeting),
        lasting=np.full(pairs, lasting),
        voting=np.full(pairs, voting),
        stops=np.full(pairs, stops),
        before_px=every * before,
        after_px=every * noise,
    )


@pytest.mark.parametrize(
    ("lasting", "least", "share", "static", "masking"),
    [
        (0.0, 0.008, 0.0, True, "none"),
        (1e-3, 0.008, 2e-3, False, "none"),
        (4e-3, 0.008, 8e-3, False, "refined"),
        (1e-2, 0.008, 2e-2, False, "refined"),
        (0.0, 0.0, 0.0, True, "refined"),
        (0.495, 1.0, 0.99, False, "none"),
    ],
)
def test_little_motion_is_not_masked(lasting, least, share, static, masking):
    """Shares of the voting pixels, half of the valid ones."""
    found = decide_motion(motion(lasting=lasting), least)
    assert found["share"] == pytest.approx(share)
    assert (found["static"], found["masking"]) == (static, masking)


@pytest.mark.parametrize(
    "unknown", [motion(pairs=0), motion(pairs=1), motion(voting=0.01), motion(noise=np.nan)]
)
def test_what_cannot_be_told_counts_as_moving(unknown):
    found = decide_motion(unknown, 1.0)
    assert found["share"] is None and found["fleeting"] is None
    assert not found["static"] and found["masking"] == "refined"


@pytest.mark.parametrize(
    "lasting, fleeting, told", [(0.0, 5e-4, True), (0.0, 1.2e-3, False), (1e-3, 1.2e-3, True)]
)
def test_much_motion_that_is_not_seen_again_cannot_be_told(lasting, fleeting, told):
    """Fractions of the valid pixels, half of which vote: 0.1 % of these is noise, 0.24 % may be something that passes fast."""
    found = decide_motion(motion(lasting=lasting, fleeting=fleeting), 0.008)
    assert found["fleeting"] == pytest.approx(2 * fleeting) and (found["share"] is not None) is told


def test_a_pair_that_is_not_judged_does_not_count():
    found = motion(lasting=1e-3)
    found.lasting[0], found.noise_px[0] = 0.4, np.nan
    assert found.share == pytest.approx(2e-3)


@pytest.mark.parametrize("before, refines", [(0.1, False), (0.115, False), (0.13, True)])
def test_poses_are_refined_where_a_correction_explains_more_than_the_noise(before, refines):
    found = decide_camera(motion(before=before))
    assert found["refine_poses"] is refines
    assert found["pose_residual_px"] == pytest.approx(np.sqrt(before**2 - 0.01), abs=1e-6)


@pytest.mark.parametrize(
    ("revisits", "stops", "refines", "compensates"),
    [(3, 0.0, True, False), (1, 0.0, False, False), (1, 0.03, False, False), (1, 0.2, False, True)],
)
def test_revisits_show_a_drift_and_a_third_of_a_stop_is_compensated(revisits, stops, refines, compensates):
    """Consecutive frames hide the drift."""
    found = motion(revisits=revisits, stops=stops)
    found.before_px[-revisits:] = 0.4
    decided = decide_camera(found)
    assert (decided["refine_poses"], decided["compensate_exposure"]) == (refines, compensates)


def test_nothing_measured_asks_for_no_correction():
    found = decide_camera(motion(pairs=0))
    assert not found["refine_poses"] and not found["compensate_exposure"]
    assert {found[name] for name in ("pose_residual_px", "pose_noise_px", "brightness_stops")} == {None}
    assert finite(None) is None and finite(np.nan) is None and finite(np.float64(0.1234567)) == 0.123457
