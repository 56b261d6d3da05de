"""What a method says of itself."""

import pytest

from egosplat_rivals.loop import fewer_iterations


@pytest.mark.parametrize(
    "done, told", [(29_999, ("29,999 of 30,000 iterations a level",)), (30_000, ()), (40_000, ())]
)
def test_only_a_shorter_training_stands_in(done, told):
    assert fewer_iterations(done, 30_000, " a level") == told
