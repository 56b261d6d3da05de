"""Decisions of a survey from its measurements, and what it cannot tell."""

import numpy as np
import pytest

from egosplat.survey.decisions import (
    brightness_range,
    compensates_exposure,
    finite,
    is_static,
    moving_share,
    needs_masks,
    pose_residual,
    refines_poses,
)
from egosplat.survey.motion import Motion


def motion(
    lasting=0.0, fleeting=0.0, voting=0.5, noise=0.1, before=0.1, pairs=6, revisits=0, stops=0.0
) -> Motion:
    """Equal pairs; ``before``: noise without a correction [px]."""
    frames, every = np.arange(pairs + 1), np.ones(pairs + revisits)
    return Motion(
        pairs=np.stack([frames[:-1], frames[1:]], axis=1),
        moving=np.full(pairs, lasting + fleeting),
        lasting=np.full(pairs, lasting),
        voting=np.full(pairs, voting),
        noise_px=np.full(pairs, noise),
        stops=np.full(pairs, stops),
        revisits=np.zeros((revisits, 2), np.int64),
        before_px=every * before,
        after_px=every * noise,
    )


def test_little_motion_is_not_masked():
    """Shares of the voting pixels, half of the valid ones."""
    shares = [motion(lasting=one).share for one in (0.0, 1e-3, 4e-3, 1e-2)]
    assert shares == pytest.approx([0.0, 2e-3, 8e-3, 2e-2])
    assert [is_static(one) for one in shares] == [True, False, False, False]
    assert [needs_masks(one, 0.008) for one in shares] == [False, False, True, True]
    assert needs_masks(0.0, 0.0) and not needs_masks(0.99, 1.0)


@pytest.mark.parametrize(
    "unknown",
    [motion(pairs=0), motion(pairs=1), motion(voting=0.01), motion(noise=np.nan)],
    ids=["no pair", "one pair", "few pixels", "nothing judged"],
)
def test_what_cannot_be_told_counts_as_moving(unknown):
    assert unknown.share is None and unknown.fleeting is None
    assert moving_share(None, None) is None and not is_static(None) and needs_masks(None, 1.0)


@pytest.mark.parametrize(
    "lasting, fleeting, told", [(0.0, 5e-4, True), (0.0, 1.2e-3, False), (1e-3, 1.2e-3, True)]
)
def test_much_motion_that_is_not_seen_again_cannot_be_told(lasting, fleeting, told):
    """Fractions of the valid pixels, half of which vote: 0.1 % of these is noise, 0.24 % may be something that passes fast."""
    found = motion(lasting=lasting, fleeting=fleeting)
    assert found.fleeting == pytest.approx(2 * fleeting)
    assert (moving_share(found.share, found.fleeting) is not None) is told


def test_a_pair_that_is_not_judged_does_not_count():
    found = motion(lasting=1e-3)
    found.lasting[0], found.noise_px[0] = 0.4, np.nan
    assert found.share == pytest.approx(2e-3)


@pytest.mark.parametrize("before, refines", [(0.1, False), (0.115, False), (0.13, True)])
def test_poses_are_refined_where_a_correction_explains_more_than_the_noise(before, refines):
    residual = pose_residual(motion(before=before))
    assert refines_poses(residual) is refines
    assert residual.explained_px == pytest.approx(np.sqrt(before**2 - 0.01), abs=1e-6)


def test_revisits_show_a_drift_that_consecutive_frames_hide():
    found = motion(revisits=3)
    found.before_px[-3:] = 0.4
    assert refines_poses(pose_residual(found))
    lonely = motion(revisits=1)
    lonely.before_px[-1:] = 0.4
    assert not refines_poses(pose_residual(lonely))


def test_nothing_measured_asks_for_no_correction():
    assert pose_residual(motion(pairs=0)) is None and not refines_poses(None)
    assert brightness_range(motion(pairs=0)) is None and not compensates_exposure(None)
    assert finite(None) is None and finite(np.nan) is None and finite(np.float64(0.1234567)) == 0.123457


def test_exposure_is_compensated_above_a_third_of_a_stop():
    assert not compensates_exposure(brightness_range(motion(stops=0.03)))
    assert compensates_exposure(brightness_range(motion(stops=0.2)))
