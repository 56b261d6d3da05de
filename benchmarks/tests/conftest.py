"""Fixtures of the other tests that measurements use, too."""

from tests.conftest import finished, number_of_threads, real_data  # noqa: F401
from tests.unit.conftest import *
from tests.unit.models.conftest import tiny_sam2  # noqa: F401
