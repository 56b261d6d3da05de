"""A missed query has one cause: the first of the pipeline."""

import pytest

from benchmarks.misses.__main__ import CAUSES, Evidence


@pytest.mark.parametrize(
    "covered, masked, shown, answered, cause",
    [
        (0.09, 1.0, 0.0, 1.0, "no mask"),
        (0.1, 0.51, 0.0, 1.0, "masked"),
        (0.1, 0.5, 0.09, 1.0, "no Gaussians"),
        (0.1, 0.5, 0.1, 0.51, "wrong pixel"),
        (0.1, 0.5, 0.1, 0.5, "wrong name"),
    ],
)
def test_the_first_cause_of_the_pipeline_is_the_one(covered, masked, shown, answered, cause):
    assert Evidence(covered, masked, shown, answered).cause == cause and cause in CAUSES
