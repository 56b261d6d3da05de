"""One thread, as for all tests."""

from tests.conftest import number_of_threads  # noqa: F401
