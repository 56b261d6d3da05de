"""Decisions of a survey from its measurements, and what it cannot tell."""

import numpy as np
import pytest

from egosplat.survey.decisions import decide_camera, decide_motion, finite
from egosplat.survey.motion import Motion


def motion(lasting=0.0, fleeting=0.0, voting=0.5, noise=0.1, before=0.1, pairs=6, revisits=0, stops=0.0):
    """Equal pairs; ``before``: noise without a correction [px]."""
    frames, every = np.arange(pairs + 1), np.ones(pairs + revisits)
    measured = {"moving": lasting + fleeting, "lasting": lasting, "voting": voting, "stops": stops}
    return Motion(
        depths=np.ones(pairs + 1),
        pairs=np.stack([frames[:-1], frames[1:]], axis=1),
        **{name: np.full(pairs, value) for name, value in measured.items()},
        before_px=every * before,
        after_px=every * noise,
    )


@pytest.mark.parametrize(
    ("lasting", "fleeting", "least", "words", "masking"),
    [
        (0.0, 5e-4, 0.012, "nothing in view keeps moving", "none"),
        (0.0, 1.2e-3, 0.012, "0.24 % moves for a short time", "none"),
        (3e-4, 0.0, 0.012, "0.06 % of the picture keeps moving", "none"),
        (5.9e-3, 1.4e-3, 0.012, "1.18 % of the picture keeps moving", "none"),
        (6e-3, 0.0, 0.012, "1.20 % of the picture keeps moving", "refined"),
        (0.0, 1.5e-3, 0.012, "0.30 % moves for a short time (limits: 1.2 % and 0.3 %)", "refined"),
        (0.0, 0.0, 0.0, "0.00 % moves for a short time (limits: 0 % and 0 %)", "refined"),
        (0.375, 0.12, 1.0, "75.00 % of the picture keeps moving", "none"),
    ],
)
def test_little_motion_is_not_masked(lasting, fleeting, least, words, masking):
    """Fractions of the valid pixels, half of which vote; a quarter of the limit is one of what moves in passing."""
    found = decide_motion(motion(lasting=lasting, fleeting=fleeting), least)
    assert found["share"] == pytest.approx(2 * lasting) and found["fleeting"] == pytest.approx(2 * fleeting)
    assert found["masking"] == masking and words in found["verdict"]
    assert found["verdict"].endswith(
        "nothing is masked" if masking == "none" else "moving objects are masked"
    )


@pytest.mark.parametrize(
    "unknown",
    [motion(pairs=0), motion(pairs=1), motion(voting=0.01), motion(noise=np.nan), motion(voting=np.nan)],
)
def test_what_cannot_be_told_is_masked(unknown):
    found = decide_motion(unknown, 1.0)
    assert found["share"] is None and found["fleeting"] is None and found["masking"] == "refined"
    assert "to know what moves, so moving objects are masked" in found["verdict"]


def test_a_pair_that_is_not_judged_does_not_count():
    found = motion(lasting=1e-3)
    found.lasting[0], found.noise_px[0] = 0.4, np.nan
    assert found.shares == pytest.approx((2e-3, 0.0))


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
